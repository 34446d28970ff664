// Reads and writes state files, which docs/formats.md describes.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "data/output_weights.hpp"
#include "io/formats/files.hpp"
#include "io/formats/provenance_text.hpp"
#include "io/formats/schema.hpp"
#include "io/guard/atomic_file.hpp"
#include "model/options.hpp"
#include "tokid/update.hpp"

namespace tokid {

namespace {

using namespace io;

const Option& method_option() { return *find_option("method"); }

Array vector_array(const Vector& v, Index rows) {
  return {{size(rows), size(v.size() / std::max<Index>(1, rows))}, std::vector<double>(v.begin(), v.end())};
}

Vector vector_of(const Fields& fields, const char* name, Index rows, Index cols) {
  const Matrix m = fields.matrix(name);
  if (m.rows() != rows || m.cols() != cols) fail_shape(name, fields.shape(name), fmt::format("({}, {})", rows, cols));
  Vector v(rows * cols);
  for (Index i = 0; i < rows; ++i) v.segment(i * cols, cols) = m.row(i).transpose();
  return v;
}

// A digest is stored as four whole numbers of 32 bits each, the highest bits first. Readers turn numbers into doubles,
// which cannot represent all whole numbers of 64 bits.
constexpr Index words_of_digest = 4;
constexpr double word_end = 4294967296.0;

Array digests_array(const std::vector<Digest>& digests) {
  Array array{{digests.size(), size(words_of_digest)}, {}};
  std::vector<std::int64_t> words;
  for (const Digest& digest : digests)
    for (const std::uint64_t half : digest) {
      words.push_back(std::int64_t(half >> 32));
      words.push_back(std::int64_t(half & 0xFFFFFFFFu));
    }
  array.values = std::move(words);
  return array;
}

std::vector<Digest> digests_of(const Fields& fields, const char* name) {
  const Matrix words = fields.matrix(name);
  if (words.rows() < 1 || words.cols() != words_of_digest)
    fail_shape(name, fields.shape(name), fmt::format("one row or more, {} columns", words_of_digest));
  if (!(words.array() >= 0 && words.array() < word_end && words.array() == words.array().floor()).all())
    fail("data set '{}': other values found, whole numbers from 0 to {:.0f} needed", name, word_end - 1);
  std::vector<Digest> digests;
  const auto half = [&](Index i, Index j) { return std::uint64_t(words(i, j)) << 32 | std::uint64_t(words(i, j + 1)); };
  for (Index i = 0; i < words.rows(); ++i) digests.push_back({half(i, 0), half(i, 2)});
  if (!std::is_sorted(digests.begin(), digests.end()))
    fail("data set '{}': rows in another order found, ascending order needed", name);
  return digests;
}

const Names& update_names() {
  static const Names names{"window_factors", "window_rows",    "sample_sums",
                           "sample_counts",  "sample_spreads", "inputs",
                           "lags",           "experiments",    "dt",
                           "options",        "method",         "states",
                           "together",       "noisy",          "nominal",
                           "initial_state",  "input_names",    "output_names",
                           "input_units",    "output_units",   "experiment_digests",
                           "without_digest"};
  return names;
}

Arrays arrays_of(const UpdateState& state, Layout layout) {
  const WindowFactors& f = state.factors;
  Arrays arrays;
  arrays.emplace_back("options", scalar(provenance_text(state.provenance)));
  arrays.emplace_back("method", scalar(method_option().write({.method = state.plan.method}).get<std::string>()));
  arrays.emplace_back("initial_state", scalar(std::string(to_string(f.initial_state))));
  arrays.emplace_back("inputs", scalar(f.inputs));
  arrays.emplace_back("lags", scalar(f.lags));
  arrays.emplace_back("states", scalar(state.plan.states));
  arrays.emplace_back("experiments", scalar(f.experiments));
  arrays.emplace_back("together", scalar(Index(state.plan.coupled)));
  arrays.emplace_back("noisy", scalar(Index(state.plan.noisy)));
  arrays.emplace_back("nominal", scalar(Index(state.plan.nominal)));
  arrays.emplace_back("dt", scalar(f.dt));
  add_channels(f.names, arrays);
  if (!state.digests.empty()) {
    arrays.emplace_back("without_digest", scalar(state.without_digest));
    arrays.emplace_back("experiment_digests", digests_array(state.digests));
  }
  arrays.emplace_back("sample_sums", vector_array(f.sum, f.steps()));
  arrays.emplace_back("sample_counts", vector_array(f.count, f.steps()));
  arrays.emplace_back("sample_spreads", vector_array(f.spread, f.steps()));
  arrays.emplace_back("window_rows", list(f.rows));
  const Index w = f.width() + 1;
  Array factors{{f.rows.size(), size(w), size(w)}, {}};
  std::vector<double> values(checked_product(factors.shape));
  for (Index k = 0; k < f.steps(); ++k)
    for (Index i = 0; i < w; ++i)
      for (Index j = 0; j < w; ++j) values[size((k * w + i) * w + j)] = f.of(k)(i, j);
  factors.values = std::move(values);
  arrays.emplace_back("window_factors", layout == Layout::matlab ? permuted(factors, {1, 2, 0}) : factors);
  return arrays;
}

Plan plan_of(const Fields& fields, const Provenance& provenance, const WindowFactors& factors) {
  Plan plan;
  const std::string method = fields.text("method");
  IdentifyOptions read;
  if (!method_option().read(read, method) || !read.method)
    fail("data set 'method': '{}' found, {} needed", method, method_option().needed());
  plan.method = *read.method;
  plan.lags = factors.lags;
  plan.initial_state = factors.initial_state;
  plan.states = fields.integer("states");
  if (plan.states < 0) fail("data set 'states': {} found, 0 or more needed", plan.states);
  plan.coupled = fields.integer("together") != 0;
  plan.noisy = fields.integer("noisy") != 0;
  plan.nominal = fields.integer("nominal") != 0;
  const IdentifyOptions asked = identify_options(provenance);
  plan.nominal_period = plan.nominal ? asked.period : 0;
  plan.feedthrough = feedthrough_choice(provenance);
  plan.rows = asked.rows, plan.cols = asked.cols;
  plan.frame = asked.frame, plan.reference_step = asked.reference_step;
  plan.choices.weighting = asked.weighting.value_or(Weighting::one_step);
  if (const Index found = Index(asked.output_weights.size()); found != 0 && found != factors.outputs)
    fail("data set 'options': {} output_weights found, {} needed, one for each output", found, factors.outputs);
  plan.output_weights = relative_weights(asked.output_weights, factors.outputs);
  if (!plan.coupled) return plan;
  if (!provenance.choices) fail("data set 'options': no 'choices' found, the choices of an identification needed");
  plan.choices = *provenance.choices;
  return plan;
}

UpdateState update_state_of(const Fields& fields) {
  UpdateState state;
  WindowFactors& f = state.factors;
  const Array factors = fields.stack("window_factors");
  const Index steps = Index(factors.shape[0]), w = Index(factors.shape[1]);
  f.names = channels_of(fields);
  f.dt = fields.number("dt");
  f.inputs = fields.integer("inputs");
  f.lags = fields.integer("lags");
  f.experiments = fields.integer("experiments");
  f.initial_state = initial_state_from(fields.text("initial_state"));
  const Index channels = f.lags >= 0 && (w - 1) % (f.lags + 1) == 0 ? (w - 1) / (f.lags + 1) : 0;
  f.outputs = channels - f.inputs;
  if (Index(factors.shape[2]) != w || f.lags < 1 || f.inputs < 1 || f.outputs < 1 || f.lags >= steps)
    fail("data set 'window_factors': shape {} found, which contradicts the {} inputs and the lag order {} of the file",
         text(factors.shape), f.inputs, f.lags);
  f.rows = fields.integers("window_rows", factors.shape[0], 0, f.experiments);
  f.sum = vector_of(fields, "sample_sums", steps, channels);
  f.count = vector_of(fields, "sample_counts", steps, channels);
  f.spread = vector_of(fields, "sample_spreads", steps, channels);
  if (!(f.dt > 0)) fail("data set 'dt': {} found, a positive number needed", f.dt);
  if (f.experiments < 1) fail("data set 'experiments': {} found, at least 1 needed", f.experiments);
  if (!f.sum.allFinite()) fail("data set 'sample_sums': infinite or missing values found, finite values needed");
  if (!(f.count.array() >= 0).all() || !(f.count.array() <= double(f.experiments)).all())
    fail("data set 'sample_counts': other values found, 0 to {} needed", f.experiments);
  if (!(f.spread.array() >= 0).all() || !f.spread.allFinite())
    fail("data set 'sample_spreads': negative, infinite or missing values found, sums of squares needed");
  f.factor.resize(w, steps * w);
  const auto& values = std::get<std::vector<double>>(factors.values);
  for (Index k = 0; k < steps; ++k)
    for (Index i = 0; i < w; ++i)
      for (Index j = 0; j < w; ++j) f.factor(i, k * w + j) = values[size((k * w + i) * w + j)];
  if (!f.factor.allFinite()) fail("data set 'window_factors': infinite or missing values found, finite values needed");
  state.provenance = checked_provenance(fields.text("options"));
  state.plan = plan_of(fields, state.provenance, f);
  state.without_digest = f.experiments;  // a state of an earlier version has no digests at all
  if (!fields.has("experiment_digests")) return state;
  state.digests = digests_of(fields, "experiment_digests");
  state.without_digest = fields.integer("without_digest");
  if (state.without_digest < 0 || state.without_digest > f.experiments)
    fail("data set 'without_digest': {} found, 0 to {} needed", state.without_digest, f.experiments);
  if (const Index fewest = f.experiments - state.without_digest; Index(state.digests.size()) < fewest)
    fail("data set 'experiment_digests': {} rows found, at least {} needed for as many experiments",
         state.digests.size(), fewest);
  return state;
}

}  // namespace

void save_update_state(const UpdateState& state, const std::filesystem::path& path) {
  save_arrays(path, {}, [&](Layout layout) { return arrays_of(state, layout); });
}

void save_update_state(const UpdateState& state, FileLock& held) {
  held.check();
  save_update_state(state, held.path());
  AtomicFile::when_published([&held] { held.see(); });
}

UpdateState load_update_state(const std::filesystem::path& path) {
  UpdateState state;
  load_arrays(path, update_names(), [&](const Fields& fields) {
    if (!is_update_state(fields.names()))
      fail("{} found, a state file that identify --state writes ('window_factors') needed",
           is_model(fields.names())      ? "a model"
           : is_ensemble(fields.names()) ? "an ensemble"
                                         : "another file");
    state = update_state_of(fields);
  });
  return state;
}

}  // namespace tokid
