// SPDX-License-Identifier: BSD-3-Clause
#include "arrays.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

namespace tokid::python {

namespace {

// Copies entries of rows to columns. The rows are `stride` entries apart; entry j of a row is begin[j] entries behind
// its first entry, and goes to the column to[j]. It copies few rows at a time, so that their cache lines are still in
// the cache for the next column.
template <class Number>
void write_columns(const Number* from, Index stride, Index rows, const std::vector<std::int64_t>& begin,
                   const std::vector<double*>& to) {
  constexpr Index block = 128;
  for (Index i = 0; i < rows; i += block) {
    const Index count = std::min(block, rows - i);
    for (size_t j = 0; j < begin.size(); ++j) {
      const Number* entry = from + i * stride + begin[j];
      double* column = to[j] + i;
      for (Index a = 0; a < count; ++a) column[a] = double(entry[a * stride]);
    }
  }
}

// Calls f with a typed pointer to the first number.
template <class Function>
void with_numbers(const AnyArray& array, Function&& f) {
  const void* data = array.data();
  const nb::dlpack::dtype type = array.dtype();
  if (type == nb::dtype<double>()) return f(static_cast<const double*>(data));
  if (type == nb::dtype<float>()) return f(static_cast<const float*>(data));
  if (type == nb::dtype<std::int64_t>()) return f(static_cast<const std::int64_t*>(data));
  if (type == nb::dtype<std::int32_t>()) return f(static_cast<const std::int32_t*>(data));
  if (type == nb::dtype<std::int16_t>()) return f(static_cast<const std::int16_t*>(data));
  if (type == nb::dtype<std::int8_t>()) return f(static_cast<const std::int8_t*>(data));
  if (type == nb::dtype<std::uint64_t>()) return f(static_cast<const std::uint64_t*>(data));
  if (type == nb::dtype<std::uint32_t>()) return f(static_cast<const std::uint32_t*>(data));
  if (type == nb::dtype<std::uint16_t>()) return f(static_cast<const std::uint16_t*>(data));
  if (type == nb::dtype<std::uint8_t>()) return f(static_cast<const std::uint8_t*>(data));
  throw nb::type_error("array: another type found, real numbers needed");
}

template <class Values>
NumPyArray owned(Values values, double* (*data)(Values&), std::vector<size_t> shape,
                 std::vector<std::int64_t> strides) {
  auto held = std::make_unique<Values>(std::move(values));
  double* first = data(*held);
  const nb::capsule owner(held.get(), [](void* p) noexcept { delete static_cast<Values*>(p); });
  held.release();  // NOLINT(bugprone-unused-return-value): the capsule owns the values now
  return {first, shape.size(), shape.data(), owner, strides.data()};
}

}  // namespace

void write_samples(const AnyArray& samples, Ensemble& ensemble, Index offset) {
  const Index steps = Index(samples.shape(1)), channels = Index(samples.shape(2));
  const Eigen::Ref<Matrix> target = ensemble.samples();
  std::vector<std::int64_t> begin;
  std::vector<double*> to;
  begin.reserve(size_t(steps * channels));
  to.reserve(size_t(steps * channels));
  for (Index k = 0; k < steps; ++k)
    for (Index i = 0; i < channels; ++i) {
      begin.push_back(k * samples.stride(1) + i * samples.stride(2));
      to.push_back(const_cast<double*>(target.data()) + (k * ensemble.channels() + offset + i) * target.outerStride());
    }
  with_numbers(samples, [&](const auto* from) {
    const nb::gil_scoped_release release;
    write_columns(from, samples.stride(0), Index(samples.shape(0)), begin, to);
  });
}

NumPyArray samples_view(Ensemble& ensemble, Index offset, Index channels, nb::handle owner) {
  const Index N = ensemble.experiments();
  const std::array<size_t, 3> shape{size_t(N), size_t(ensemble.steps()), size_t(channels)};
  const std::array<std::int64_t, 3> strides{1, N * ensemble.channels(), N};
  return {ensemble.samples().data() + N * offset, 3, shape.data(), owner, strides.data()};
}

FreeResponse free_response_of(const AnyArray& y) {
  const Index experiments = Index(y.shape(0)), steps = Index(y.shape(1)), m = Index(y.shape(2));
  Ensemble samples(experiments, steps, 0, m, 1.0, Ensemble::Samples::unset);
  write_samples(y, samples, 0);
  return {experiments, steps, samples.samples()};
}

NumPyArray outputs_of(const Ensemble& ensemble) {
  const Index N = ensemble.experiments(), T = ensemble.steps(), m = ensemble.outputs();
  std::vector<double> values(size_t(N * T * m));
  {
    const nb::gil_scoped_release release;
    constexpr Index block = 8;  // experiments that are copied together, so that each cache line is read once
    for (Index n = 0; n < N; n += block)
      for (Index k = 0; k < T; ++k)
        for (Index j = 0; j < m; ++j)
          for (Index e = n; e < std::min(n + block, N); ++e) values[size_t((e * T + k) * m + j)] = ensemble.y(e, k, j);
  }
  return array_of(std::move(values), {size_t(N), size_t(T), size_t(m)});
}

ReadOnlyArray view_of(const Matrix& matrix, nb::handle owner) {
  return view_of(Eigen::Map<const Matrix>(matrix.data(), matrix.rows(), matrix.cols()), owner);
}

ReadOnlyArray view_of(const Vector& vector, nb::handle owner) {
  return view_of(Eigen::Map<const Vector>(vector.data(), vector.size()), owner);
}

ReadOnlyArray view_of(const Eigen::Map<const Matrix>& matrix, nb::handle owner) {
  const std::array<size_t, 2> shape{size_t(matrix.rows()), size_t(matrix.cols())};
  const std::array<std::int64_t, 2> strides{1, matrix.rows()};
  return {matrix.data(), 2, shape.data(), owner, strides.data()};
}

ReadOnlyArray view_of(const Eigen::Map<const Vector>& vector, nb::handle owner) {
  const std::array<size_t, 1> shape{size_t(vector.size())};
  return {vector.data(), 1, shape.data(), owner};
}

NumPyArray array_of(Matrix matrix) {
  const size_t rows = size_t(matrix.rows()), cols = size_t(matrix.cols());
  return owned<Matrix>(std::move(matrix), [](Matrix& m) { return m.data(); }, {rows, cols}, {1, std::int64_t(rows)});
}

NumPyArray array_of(Vector vector) {
  const size_t size = size_t(vector.size());
  return owned<Vector>(std::move(vector), [](Vector& v) { return v.data(); }, {size}, {1});
}

NumPyArray array_of(std::vector<double> values, std::vector<size_t> shape) {
  std::vector<std::int64_t> strides(shape.size(), 1);
  for (size_t i = shape.size(); i-- > 1;) strides[i - 1] = strides[i] * std::int64_t(shape[i]);
  return owned<std::vector<double>>(
      std::move(values), [](std::vector<double>& v) { return v.data(); }, std::move(shape), std::move(strides));
}

Matrix matrix_of(const AnyArray& array) {
  const Index rows = Index(array.shape(0)), cols = array.ndim() > 1 ? Index(array.shape(1)) : 1;
  const Index down = array.stride(0), across = array.ndim() > 1 ? array.stride(1) : 0;
  Matrix result(rows, cols);
  with_numbers(array, [&](const auto* from) {
    for (Index c = 0; c < cols; ++c)
      for (Index r = 0; r < rows; ++r) result(r, c) = double(from[r * down + c * across]);
  });
  return result;
}

Vector vector_of(const AnyArray& array) {
  const Matrix column = matrix_of(array);
  return column.col(0);
}

}  // namespace tokid::python
