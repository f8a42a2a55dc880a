// NumPy arrays at the border: read through the buffer protocol, made by numpy.empty. Binding code only.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <initializer_list>
#include <vector>

namespace nb = nanobind;

namespace pieper::bind {

// Raised when an argument is not a plain float64 array of the right shape. The Python side then finds out what is wrong
// and either converts the argument or says so in words.
[[noreturn]] void not_plain(const char* what);

// A C-contiguous float64 buffer, or a list or tuple of floats, held while it is read. The last `inner` dimensions must
// equal `shape`; those before are leading axes.
class Input {
 public:
  Input(nb::handle object, std::initializer_list<std::size_t> shape, const char* what);
  ~Input();
  Input(const Input&) = delete;
  Input& operator=(const Input&) = delete;

  const double* data() const { return data_; }
  std::size_t count() const { return count_; }  // product of the leading axes
  const std::vector<Py_ssize_t>& leading() const { return leading_; }
  void require_finite() const;
  void require_within(double limit) const;

 private:
  bool read_sequence(nb::handle object, std::size_t n);

  Py_buffer view_{};
  bool held_ = false;
  double small_[64];
  const double* data_ = nullptr;
  std::size_t count_ = 1, width_ = 1;
  std::vector<Py_ssize_t> leading_;
  const char* what_;
};

// A writable float64 array of shape leading + inner: a new one, or `out` when it is not None.
class Output {
 public:
  // `single` is the shape tuple of one result, which spares making it again for every call.
  Output(const std::vector<Py_ssize_t>& leading, std::initializer_list<std::size_t> inner, nb::handle out,
         nb::handle single = {});
  ~Output();
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  double* data() const { return static_cast<double*>(view_.buf); }
  nb::object array() const { return array_; }

 private:
  nb::object array_;
  Py_buffer view_{};
};

// numpy.dtype(name), and numpy.empty(shape, dtype), float64 without a dtype.
nb::object numpy_dtype(const char* name);
nb::object new_array(nb::handle shape, nb::handle dtype = {});

// The tuple of sizes that numpy.empty takes.
nb::object shape_tuple(const std::vector<Py_ssize_t>& leading, std::initializer_list<std::size_t> inner);

// A new numpy array of another type than float64.
template <class Number>
class NewArray {
 public:
  NewArray(const std::vector<Py_ssize_t>& leading, std::initializer_list<std::size_t> inner, const char* dtype) {
    static PyObject* type = numpy_dtype(dtype).release().ptr();  // one for each Number
    array_ = new_array(shape_tuple(leading, inner), type);
    if (PyObject_GetBuffer(array_.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE) != 0) throw nb::python_error();
  }
  ~NewArray() { PyBuffer_Release(&view_); }
  NewArray(const NewArray&) = delete;
  NewArray& operator=(const NewArray&) = delete;
  Number* data() const { return static_cast<Number*>(view_.buf); }
  nb::object array() const { return array_; }

 private:
  nb::object array_;
  Py_buffer view_{};
};

// As pieper.spatial checks poses: (count, 4, 4), a rotation to 1e-9, and the last row 0 0 0 1.
bool all_poses(const double* T, std::size_t count);

// Runs `work` without the interpreter lock when there is enough of it to be worth a release.
template <class Work>
auto without_lock(std::size_t count, Work work) {
  if (count < 32) return work();
  nb::gil_scoped_release released;
  return work();
}

}  // namespace pieper::bind
