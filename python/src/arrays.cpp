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

// Calls f with a typed pointer to the first number, if the numbers have one of these types.
template <class... Numbers, class Function>
bool with_numbers(const AnyArray& array, const Function& f) {
  return ((array.dtype() == nb::dtype<Numbers>() && (f(static_cast<const Numbers*>(array.data())), true)) || ...);
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
  const auto write = [&](const auto* from) {
    const nb::gil_scoped_release release;
    write_columns(from, samples.stride(0), Index(samples.shape(0)), begin, to);
  };
  if (!with_numbers<double, float, std::int64_t, std::int32_t, std::int16_t, std::int8_t, std::uint64_t, std::uint32_t,
                    std::uint16_t, std::uint8_t>(samples, write))
    throw nb::type_error("array: another type found, real numbers needed");
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

ReadOnlyArray view_of(const Eigen::Map<const Matrix>& matrix, nb::handle owner) {
  const std::array<size_t, 2> shape{size_t(matrix.rows()), size_t(matrix.cols())};
  const std::array<std::int64_t, 2> strides{1, matrix.rows()};
  return {matrix.data(), 2, shape.data(), owner, strides.data()};
}

ReadOnlyArray view_of(const Eigen::Map<const Vector>& vector, nb::handle owner) {
  const std::array<size_t, 1> shape{size_t(vector.size())};
  return {vector.data(), 1, shape.data(), owner};
}

NumPyArray array_of(std::vector<double> values, std::vector<size_t> shape) {
  auto held = std::make_unique<std::vector<double>>(std::move(values));
  double* first = held->data();
  const nb::capsule owner(held.release(), [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return {first, shape.size(), shape.data(), owner};
}

}  // namespace tokid::python
