#include "pieper/segmentation.hpp"

#include <algorithm>

#include "chain.hpp"

namespace pieper::bind {
namespace {

// A buffer of bytes of any strides, held while it is read.
class Bytes {
 public:
  Bytes(nb::handle object, const char* what) {
    if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_STRIDED_RO | PyBUF_FORMAT) != 0) {
      PyErr_Clear();
      not_plain(what);
    }
    if (view_.itemsize == 1 && view_.format && view_.format[0] == 'B' && view_.format[1] == '\0') return;
    PyBuffer_Release(&view_);
    not_plain(what);
  }
  ~Bytes() { PyBuffer_Release(&view_); }
  Bytes(const Bytes&) = delete;
  Bytes& operator=(const Bytes&) = delete;
  int axes() const { return view_.ndim; }
  std::size_t size(int axis) const { return static_cast<std::size_t>(view_.shape[axis]); }
  std::ptrdiff_t stride(int axis) const { return view_.strides[axis]; }
  const std::uint8_t* data() const { return static_cast<const std::uint8_t*>(view_.buf); }
  // The axes from `axis` on lie without gaps.
  bool dense(int axis) const {
    std::ptrdiff_t step = 1;
    for (int k = view_.ndim - 1; k >= axis; --k) {
      if (view_.shape[k] != 1 && view_.strides[k] != step) return false;
      step *= view_.shape[k];
    }
    return true;
  }

 private:
  Py_buffer view_{};
};

struct NativeColorLookUp {
  ColorLookUp look_up;
  NativeColorLookUp(const std::uint8_t* labels, unsigned bits, bool reversed) : look_up(labels, bits, reversed) {}
};

// Packed (height, width, 3), YUYV (height, width, 2), planar (height * 3 / 2, width).
FrameView frame_of(const Bytes& image, PixelLayout layout) {
  FrameView frame{layout, 0, 0, image.data(), 0, {nullptr, nullptr}, 0};
  const bool planar = layout == PixelLayout::i420 || layout == PixelLayout::nv12;
  if (image.axes() != (planar ? 2 : 3)) not_plain("image");
  const std::size_t rows = image.size(0);
  frame.width = image.size(1), frame.height = planar ? rows / 3 * 2 : rows;
  frame.stride = image.stride(0);
  if (frame.width > largest_side || rows > largest_side) not_plain("image");
  if (rows == 0 || frame.width == 0) {
    if (!planar && image.size(2) != (layout == PixelLayout::packed ? 3u : 2u)) not_plain("image");
    return frame;
  }
  if (!image.dense(1)) not_plain("image");
  if (!planar) {
    if (image.size(2) != (layout == PixelLayout::packed ? 3u : 2u)) not_plain("image");
    if (layout == PixelLayout::yuyv && frame.width % 2 != 0) not_plain("image");
    return frame;
  }
  if (rows % 3 != 0 || frame.width % 2 != 0) not_plain("image");
  frame.chroma[0] = frame.rows + static_cast<std::ptrdiff_t>(frame.height) * frame.stride;
  if (layout == PixelLayout::nv12) {
    frame.chroma_stride = frame.stride;
    return frame;
  }
  if (!image.dense(0)) not_plain("image");  // half rows follow each other across the rows of the array
  frame.chroma_stride = static_cast<std::ptrdiff_t>(frame.width / 2);
  frame.chroma[1] = frame.chroma[0] + frame.width / 2 * (frame.height / 2);
  return frame;
}

}  // namespace

void bind_segmentation(nb::module_& module) {
  nb::enum_<PixelLayout>(module, "PixelLayout")
      .value("packed", PixelLayout::packed)
      .value("i420", PixelLayout::i420)
      .value("nv12", PixelLayout::nv12)
      .value("yuyv", PixelLayout::yuyv);
  module.attr("largest_side") = largest_side;
  nb::class_<NativeColorLookUp>(module, "ColorLookUp")
      .def(
          "__init__",
          [](NativeColorLookUp* self, nb::handle labels, bool reversed) {
            const Bytes bytes(labels, "labels");
            if (bytes.axes() != 3 || !bytes.dense(0)) not_plain("labels");
            unsigned bits = 1;
            while (bits < 8 && std::size_t{1} << bits < bytes.size(0)) ++bits;
            for (int axis = 0; axis < 3; ++axis)
              if (bytes.size(axis) != std::size_t{1} << bits) not_plain("labels");
            new (self) NativeColorLookUp(bytes.data(), bits, reversed);
          },
          nb::arg("labels"), nb::arg("reversed"),
          "Labels (2^k, 2^k, 2^k) by the bytes of a pixel, or by their reverse.")
      .def(
          "segment",
          [](const NativeColorLookUp& self, nb::handle image, PixelLayout layout, std::uint64_t min_area,
             std::uint64_t max_area, bool refine, bool numbered) {
            const Bytes bytes(image, "image");
            const FrameView frame = frame_of(bytes, layout);
            const NewArray<std::int32_t> numbers({}, {numbered ? frame.height : 0, frame.width}, "i4");
            std::vector<Blob> blobs;
            {
              nb::gil_scoped_release released;
              blobs = segment(frame, self.look_up, {min_area, max_area, refine}, numbered ? numbers.data() : nullptr);
            }
            const std::size_t k = blobs.size();
            const NewArray<std::int64_t> color({}, {k}, "i8"), extent({}, {k, 4}, "i8");
            const Output centroid({}, {k, 2}, nb::none()), covariance({}, {k, 2, 2}, nb::none()),
                area({}, {k}, nb::none()), circularity({}, {k}, nb::none());
            for (std::size_t i = 0; i < k; ++i) {
              const Blob& blob = blobs[i];
              color.data()[i] = blob.label - 1;
              const std::int64_t box[4] = {blob.left, blob.top, blob.width, blob.height};
              std::copy_n(box, 4, extent.data() + 4 * i);
              centroid.data()[2 * i] = blob.x, centroid.data()[2 * i + 1] = blob.y;
              const double spread[4] = {blob.xx, blob.xy, blob.xy, blob.yy};
              std::copy_n(spread, 4, covariance.data() + 4 * i);
              area.data()[i] = static_cast<double>(blob.area);
              circularity.data()[i] = blob.circularity;
            }
            return nb::make_tuple(color.array(), centroid.array(), covariance.array(), area.array(), extent.array(),
                                  circularity.array(), numbers.array());
          },
          nb::arg("image"), nb::arg("layout"), nb::arg("min_area"), nb::arg("max_area"), nb::arg("refine"),
          nb::arg("numbered"),
          nb::sig("def segment(self, image: object, layout: PixelLayout, min_area: int, max_area: int, refine: bool, "
                  "numbered: bool) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], "
                  "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], "
                  "numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], "
                  "numpy.typing.NDArray[numpy.int32]]"),
          "Of k blobs: color (k,), centroid (k, 2), covariance (k, 2, 2), area (k,), extent (k, 4), circularity (k,); and "
          "the number of each pixel's blob, from 1, if they are to be numbered.")
      .def(
          "classify",
          [](const NativeColorLookUp& self, nb::handle image, PixelLayout layout) {
            const Bytes bytes(image, "image");
            const FrameView frame = frame_of(bytes, layout);
            const NewArray<std::uint8_t> labels({}, {frame.height, frame.width}, "u1");
            {
              nb::gil_scoped_release released;
              classify(frame, self.look_up, labels.data());
            }
            return labels.array();
          },
          nb::arg("image"), nb::arg("layout"),
          nb::sig("def classify(self, image: object, layout: PixelLayout) -> numpy.typing.NDArray[numpy.uint8]"),
          "The label of each pixel, (height, width).");
}

}  // namespace pieper::bind
