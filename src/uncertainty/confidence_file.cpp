// Confidence bounds in files: docs/formats.md.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "base/nan.hpp"
#include "io/formats/files.hpp"
#include "io/formats/schema.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid {

namespace {

using namespace io;

struct Part {
  const char* suffix;
  Matrix Interval::*values;
};
constexpr Part parts[] = {{"", &Interval::estimate}, {"_lower", &Interval::lower}, {"_upper", &Interval::upper}};

// (S, band+1, m, r)
Array markov_array(const MarkovBounds& markov, Matrix Interval::*part, Layout layout) {
  const Index m = markov.outputs, r = markov.inputs;
  std::vector<double> values;
  for (size_t k = size(markov.k_begin); k < markov.step.size(); ++k)
    for (Index gap = 0; gap <= markov.band; ++gap)
      for (Index j = 0; j < m; ++j)
        for (Index i = 0; i < r; ++i) values.push_back((markov.step[k].*part)(j, gap * r + i));
  Array array{{markov.step.size() - size(markov.k_begin), size(markov.band + 1), size(m), size(r)}, std::move(values)};
  return layout == Layout::matlab ? permuted(array, {2, 3, 1, 0}) : array;
}

// (N, T, m)
Array output_array(const OutputBounds& outputs, Matrix Interval::*part) {
  const Index experiments = outputs.step.front().estimate.rows(), m = outputs.step.front().estimate.cols();
  std::vector<double> values;
  for (Index n = 0; n < experiments; ++n)
    for (const Interval& step : outputs.step)
      for (Index j = 0; j < m; ++j) values.push_back((step.*part)(n, j));
  return {{size(experiments), outputs.step.size(), size(m)}, std::move(values)};
}

// (E, n); steps with fewer states are filled up with NaN.
template <class Value>
Array spectrum_array(const SpectrumBounds& spectrum, Index states, Value&& value) {
  std::vector<double> values;
  for (const SpectrumBounds::Step& step : spectrum.step)
    for (Index e = 0; e < states; ++e) values.push_back(e < step.eigenvalues.size() ? value(step, e) : nan);
  return {{spectrum.step.size(), size(states)}, std::move(values)};
}

void add_spectrum(const SpectrumBounds& spectrum, Arrays& arrays) {
  Index states = 0;
  for (const SpectrumBounds::Step& step : spectrum.step) states = std::max(states, step.eigenvalues.size());
  arrays.emplace_back("eigenvalues_k_begin", scalar(spectrum.begin));
  arrays.emplace_back("eigenvalues_simple", spectrum_array(spectrum, states, [](const auto& step, Index e) {
                        return double(step.simple(e));
                      }));
  arrays.emplace_back("eigenvalues_covariance",
                      spectrum_array(spectrum, states, [](const auto& step, Index e) { return step.covariance(e); }));
  for (const auto& [name, interval] : {std::pair{"eigenvalues_real", &SpectrumBounds::Step::real},
                                       std::pair{"eigenvalues_imag", &SpectrumBounds::Step::imaginary}}) {
    for (const Part& part : parts)
      arrays.emplace_back(std::string(name) + part.suffix,
                          spectrum_array(spectrum, states, [&](const auto& step, Index e) {
                            return ((step.*interval).*part.values)(e);
                          }));
    arrays.emplace_back(
        std::string(name) + "_deviation",
        spectrum_array(spectrum, states, [&](const auto& step, Index e) { return (step.*interval).deviation(e); }));
  }
}

Arrays arrays_of(const Confidence& c, Layout layout) {
  Arrays arrays;
  arrays.emplace_back("level", scalar(c.level));
  arrays.emplace_back("experiments", scalar(c.experiments));
  arrays.emplace_back("lags", scalar(c.lags));
  arrays.emplace_back("replicates", scalar(c.replicates));
  arrays.emplace_back("freedom", scalar(c.freedom));
  if (c.smoothing > 0) {
    arrays.emplace_back("smoothing", scalar(c.smoothing));
    arrays.emplace_back("bias", Array{{size(c.bias.size())}, std::vector<double>(c.bias.begin(), c.bias.end())});
  }
  arrays.emplace_back("dt", scalar(c.dt));
  add_channels(c.names, arrays);
  if (!c.spectrum.step.empty()) add_spectrum(c.spectrum, arrays);
  for (const Part& part : parts)
    arrays.emplace_back(std::string("simulated") + part.suffix, output_array(c.simulated, part.values));
  arrays.emplace_back("k_begin", scalar(c.markov.k_begin));
  for (const Part& part : parts)
    arrays.emplace_back(std::string("markov") + part.suffix, markov_array(c.markov, part.values, layout));
  return arrays;
}

}  // namespace

void save_confidence(const Confidence& confidence, const std::filesystem::path& path, const WriteOptions& options) {
  save_arrays(path, options, [&](Layout layout) { return arrays_of(confidence, layout); });
}

}  // namespace tokid
