#include "arrays.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pieper/kernels.hpp"

namespace pieper::bind {
namespace {

bool is_float64(const Py_buffer& view) {
  return view.itemsize == sizeof(double) && view.format && view.format[0] == 'd' && view.format[1] == '\0';
}

// numpy.empty, looked up once.
nb::handle numpy_empty() {
  static PyObject* empty = nb::object(nb::module_::import_("numpy").attr("empty")).release().ptr();
  return empty;
}

}  // namespace

nb::object numpy_dtype(const char* name) { return nb::module_::import_("numpy").attr("dtype")(name); }

nb::object new_array(nb::handle shape, nb::handle dtype) {
  PyObject* array = PyObject_CallFunctionObjArgs(numpy_empty().ptr(), shape.ptr(), dtype.ptr(), nullptr);
  if (!array) throw nb::python_error();
  return nb::steal(array);
}

nb::object shape_tuple(const std::vector<Py_ssize_t>& leading, std::initializer_list<std::size_t> inner) {
  PyObject* shape = PyTuple_New(static_cast<Py_ssize_t>(leading.size() + inner.size()));
  Py_ssize_t k = 0;
  for (Py_ssize_t size : leading) PyTuple_SetItem(shape, k++, PyLong_FromSsize_t(size));
  for (std::size_t size : inner) PyTuple_SetItem(shape, k++, PyLong_FromSize_t(size));
  return nb::steal(shape);
}

void not_plain(const char* what) { throw nb::type_error(what); }

bool Input::read_sequence(nb::handle object, std::size_t n) {
  const bool list = PyList_Check(object.ptr());
  if (!list && !PyTuple_Check(object.ptr())) return false;
  const Py_ssize_t size = list ? PyList_Size(object.ptr()) : PyTuple_Size(object.ptr());
  if (size != static_cast<Py_ssize_t>(n) || n > 64) return false;
  for (Py_ssize_t k = 0; k < size; ++k) {
    PyObject* item = list ? PyList_GetItem(object.ptr(), k) : PyTuple_GetItem(object.ptr(), k);
    if (!PyFloat_CheckExact(item)) return false;
    small_[k] = PyFloat_AsDouble(item);
  }
  data_ = small_;
  return true;
}

Input::Input(nb::handle object, std::initializer_list<std::size_t> shape, const char* what) : what_(what) {
  for (std::size_t size : shape) width_ *= size;
  if (shape.size() == 1 && read_sequence(object, *shape.begin())) return;
  if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
    PyErr_Clear();
    not_plain(what);
  }
  held_ = true;
  const int inner = static_cast<int>(shape.size());
  bool fits = is_float64(view_) && view_.ndim >= inner;
  if (fits) {
    int k = view_.ndim - inner;
    for (std::size_t size : shape) fits = fits && view_.shape[k++] == static_cast<Py_ssize_t>(size);
  }
  if (!fits) {
    PyBuffer_Release(&view_);
    held_ = false;
    not_plain(what);
  }
  for (int k = 0; k < view_.ndim - inner; ++k) {
    leading_.push_back(view_.shape[k]);
    count_ *= static_cast<std::size_t>(view_.shape[k]);
  }
  data_ = static_cast<const double*>(view_.buf);
}

Input::~Input() {
  if (held_) PyBuffer_Release(&view_);
}

void Input::require_finite() const { require_within(std::numeric_limits<double>::max()); }

void Input::require_within(double limit) const {
  if (!kernels().all_within(data_, count_ * width_, limit)) not_plain(what_);
}

Output::Output(const std::vector<Py_ssize_t>& leading, std::initializer_list<std::size_t> inner, nb::handle out,
               nb::handle single) {
  if (!out.is_none()) {
    array_ = nb::borrow(out);
  } else if (leading.empty() && single.is_valid()) {
    array_ = new_array(single);
  } else {
    array_ = new_array(shape_tuple(leading, inner));
  }
  if (PyObject_GetBuffer(array_.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | PyBUF_WRITABLE) != 0) {
    PyErr_Clear();
    not_plain("out");
  }
  bool fits = is_float64(view_) && view_.ndim == static_cast<int>(leading.size() + inner.size());
  int k = 0;
  for (Py_ssize_t size : leading) fits = fits && view_.shape[k++] == size;
  for (std::size_t size : inner) fits = fits && view_.shape[k++] == static_cast<Py_ssize_t>(size);
  if (!fits) {
    PyBuffer_Release(&view_);
    not_plain("out");
  }
}

Output::~Output() { PyBuffer_Release(&view_); }

bool all_poses(const double* T, std::size_t count) {
  constexpr double tolerance = 1e-9;
  for (std::size_t k = 0; k < count; ++k, T += 16) {
    double worst = std::max({std::abs(T[12]), std::abs(T[13]), std::abs(T[14]), std::abs(T[15] - 1)});
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c <= r; ++c) {
        const double dot = T[4 * r] * T[4 * c] + T[4 * r + 1] * T[4 * c + 1] + T[4 * r + 2] * T[4 * c + 2];
        worst = std::max(worst, std::abs(dot - (r == c ? 1.0 : 0.0)));
      }
    const double determinant =
        T[0] * (T[5] * T[10] - T[6] * T[9]) - T[1] * (T[4] * T[10] - T[6] * T[8]) + T[2] * (T[4] * T[9] - T[5] * T[8]);
    if (!(worst <= tolerance) || !(determinant > 0)) return false;
  }
  return true;
}

}  // namespace pieper::bind
