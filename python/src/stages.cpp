// The stages of the method. Their values are dataclasses of arrays in tokid/stages.py; here they become the values of
// the library, and the results become fields.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "arrays.hpp"
#include "call.hpp"
#include "data/content_order.hpp"
#include "results.hpp"
#include "tokid/em.hpp"
#include "tokid/plan.hpp"
#include "tokid/stage_values.hpp"
#include "tokid/subspace.hpp"

namespace tokid::python {

namespace {

// The dataclasses hold their numbers in the order of C.
using Numbers = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Counts = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// One (rows × cols) matrix for each step, as an array (T, rows, cols).
class Stack {
 public:
  explicit Stack(Numbers numbers) : numbers_(std::move(numbers)) {}
  Index steps() const { return Index(numbers_.shape(0)); }
  Index rows() const { return Index(numbers_.shape(1)); }
  Index cols() const { return Index(numbers_.shape(2)); }
  Eigen::Map<const RowMajor> operator[](Index k) const {
    return {numbers_.data() + k * rows() * cols(), rows(), cols()};
  }

 private:
  Numbers numbers_;
};

template <class Result>
Result field(nb::handle value, const char* name) {
  return nb::cast<Result>(value.attr(name));
}

// The value of `member` at each step.
template <class Step, class T>
std::vector<T> each(const std::vector<Step>& steps, T Step::*member) {
  std::vector<T> values;
  for (const Step& step : steps) values.push_back(step.*member);
  return values;
}

// The arrays of the dataclass GtvArx. Only reading the fields needs the GIL: the arrays are read-only, and `value`
// keeps them alive.
struct ArxFields {
  nb::handle value;
  Stack coefficients{field<Numbers>(value, "coefficients")}, residual_cov{field<Numbers>(value, "residual_cov")};
  Numbers output_rms = field<Numbers>(value, "output_rms");
  Counts lags = field<Counts>(value, "lags");
  Index inputs = field<Index>(value, "inputs"), k_begin = field<Index>(value, "k_begin");
  bool feedthrough = field<bool>(value, "feedthrough");
  std::optional<Numbers> noise_shape = field<std::optional<Numbers>>(value, "noise_shape");
  std::optional<Numbers> condition = field<std::optional<Numbers>>(value, "condition");
  std::optional<Counts> rank = field<std::optional<Counts>>(value, "rank");
  std::optional<Counts> rows = field<std::optional<Counts>>(value, "rows");
  std::optional<Counts> freedom = field<std::optional<Counts>>(value, "freedom");

  // The checked regressions. If `shapes` is true and there are no noise shapes, they get shapes without columns: their
  // variances are zero.
  GtvArx regressions(bool shapes = false) const {
    GtvArx arx;
    arx.feedthrough = feedthrough;
    const Index lags_max = *std::max_element(lags.data(), lags.data() + lags.shape(0));
    arx.resize(coefficients.steps(), inputs, coefficients.rows(), lags_max, shapes || noise_shape);
    arx.begin_at(k_begin);
    for (Index k = arx.k_begin; k < arx.steps(); ++k) {
      checkpoint();
      write(arx, k, lags_max);
    }
    check(arx);
    return arx;
  }

  void write(GtvArx& arx, Index k, Index lags_max) const {
    const Index d = arx.inputs + arx.outputs;
    GtvArxStep& step = arx.step[size_t(k)];
    step.lags = lags.data()[k];
    if (condition) step.condition = condition->data()[k];
    if (rows) step.rows = rows->data()[k];
    if (freedom) step.freedom = freedom->data()[k];
    const Index own = arx.regressors(k), before = (lags_max - step.lags) * d;
    const auto all = coefficients[k];
    // Samples before step 0 are zero, and so their coefficients have no effect.
    const Index absent = std::max<Index>(0, lags_max - k) * d;
    check_zero(all.middleCols(absent, std::max<Index>(0, before - absent)), [&] {
      return fmt::format("coefficients: nonzero ones of older samples found at step {}, {} lags needed as in lags", k,
                         step.lags);
    });
    if (!feedthrough)
      check_zero(all.rightCols(arx.inputs), [&] {
        return fmt::format(
            "coefficients: nonzero ones of the inputs of step {} found, zeros needed without feedthrough", k);
      });
    arx.coefficients(k) = all.middleCols(before, own);
    arx.residual_cov(k) = residual_cov[k];
    arx.output_rms(k) = Eigen::Map<const Vector>(output_rms.data() + k * arx.outputs, arx.outputs);
    if (noise_shape)
      write_shape(arx, k, Stack(*noise_shape)[k].middleRows(before, own));
    else if (rank && !arx.has_noise_shape())
      step.rank = rank->data()[k];
  }

  // Columns that the library does not store must be zero.
  template <class Entries, class Message>
  static void check_zero(const Entries& entries, Message&& message) {
    if (!entries.isZero(0)) throw std::invalid_argument(message());
  }

  template <class Shape>
  void write_shape(GtvArx& arx, Index k, const Shape& given) const {
    if (!rank) return set_noise_shape(arx, k, given);
    const Index q = rank->data()[k], most = std::min<Index>(given.rows(), given.cols());
    if (q < 0 || q > most)
      throw std::invalid_argument(fmt::format("rank: {} found at step {}, 0 to {} needed", q, k, most));
    set_noise_shape(arx, k, given.leftCols(q));
  }
};

nb::dict fields_of(const GtvArx& arx) {
  const Index T = arx.steps(), m = arx.outputs, r = arx.inputs, d = r + m;
  const std::vector<Index> lags = each(arx.step, &GtvArxStep::lags), rank = each(arx.step, &GtvArxStep::rank);
  const Index lags_max = *std::max_element(lags.begin(), lags.end());
  const Index rank_max = *std::max_element(rank.begin(), rank.end());
  // Column j of the arrays is this column of the regression of step k, which may have fewer lags.
  const auto own = [&](Index k, Index j) { return j - (lags_max - arx.step[size_t(k)].lags) * d; };
  const auto coefficient = [&](Index k, Index i, Index j) {
    return k < arx.k_begin || own(k, j) < 0 ? 0.0 : arx.coefficients(k)(i, own(k, j));
  };
  const auto shape = [&](Index k, Index j, Index q) {
    const bool none = k < arx.k_begin || own(k, j) < 0 || q >= arx.step[size_t(k)].rank;
    return none ? 0.0 : arx.noise_shape(k)(own(k, j), q);
  };
  const auto covariance = [&](Index k, Index i, Index j) { return arx.residual_cov(k)(i, j); };
  const auto rms = [&](Index k, Index i) { return arx.output_rms(k)(i); };
  const Index L = lags_max * d + r;
  return dict_of(
      {{"inputs", r},
       {"coefficients", nb::cast(array_of_entries(coefficient, T, m, L))},
       {"lags", lags},
       {"residual_cov", nb::cast(array_of_entries(covariance, T, m, m))},
       {"output_rms", nb::cast(array_of_entries(rms, T, m))},
       {"noise_shape", arx.has_noise_shape() ? nb::cast(array_of_entries(shape, T, L, rank_max)) : nb::none()},
       {"feedthrough", arx.feedthrough},
       {"k_begin", arx.k_begin},
       {"rank", rank},
       {"condition", each(arx.step, &GtvArxStep::condition)},
       {"rows", each(arx.step, &GtvArxStep::rows)},
       {"freedom", each(arx.step, &GtvArxStep::freedom)}});
}

nb::dict fields_of(const Markov& h, bool variances) {
  // (T, band, m, cols); block γ-1 of step k is in the columns (γ-1)·cols … of matrix(k)
  const auto blocks = [&](Index cols, const auto& matrix) {
    const auto entry = [&](Index k, Index g, Index i, Index j) { return matrix(k)(i, g * cols + j); };
    return nb::cast(array_of_entries(entry, h.steps(), h.band, h.outputs, cols));
  };
  const auto d = [&](Index k, Index i, Index j) { return h.D(k)(i, j); };
  return dict_of(
      {{"system", blocks(h.inputs, [&](Index k) { return h.system(k); })},
       {"gain", blocks(h.outputs, [&](Index k) { return h.gain(k); })},
       {"D", nb::cast(array_of_entries(d, h.steps(), h.outputs, h.inputs))},
       {"system_noise", variances ? blocks(h.inputs, [&](Index k) { return h.system_noise(k); }) : nb::none()},
       {"i_begin", h.i_begin}});
}

// The arrays of the dataclass Markov. As in ArxFields, only reading the fields needs the GIL.
struct MarkovFields {
  nb::handle value;
  Numbers system = field<Numbers>(value, "system"), gain = field<Numbers>(value, "gain");
  Stack D{field<Numbers>(value, "D")};
  Index i_begin = field<Index>(value, "i_begin");
  std::optional<Numbers> noise = field<std::optional<Numbers>>(value, "system_noise");

  // The checked Markov parameters, without those before i_begin.
  Markov markov() const {
    const Index T = D.steps(), band = Index(system.shape(1)), m = D.rows(), r = D.cols();
    Markov h(T, r, m, band, i_begin);
    const auto block = [&](const Numbers& numbers, Index k, Index i, Index cols) {
      return Eigen::Map<const RowMajor>(numbers.data() + (k * band + k - i - 1) * m * cols, m, cols);
    };
    for (Index k = h.i_begin; k < T; ++k) {
      checkpoint();
      h.D(k) = D[k];
      for (Index i = std::max(h.i_begin, k - band); i < k; ++i) {
        h.h(k, i) = block(system, k, i, r);
        h.h_gain(k, i) = block(gain, k, i, m);
        if (noise) h.h_noise(k, i) = block(*noise, k, i, r);
      }
    }
    check(h);
    return h;
  }
};

nb::dict fields_of(const HankelFactors& s, const TveraOptions& options) {
  return dict_of({Field("u", each(s.step, &HankelFactor::u)),
                  Field("singular_values", each(s.step, &HankelFactor::singular_values)),
                  Field("scale", each(s.step, &HankelFactor::scale)),
                  Field("error", each(s.step, &HankelFactor::error)), FIELD(rows), FIELD(cols), FIELD(k_begin),
                  Field("output_size", options.output_size), Field("input_size", options.input_size)});
}

HankelFactors factors_of(nb::handle value) {
  HankelFactors factors{field<Index>(value, "rows"), field<Index>(value, "cols"), field<Index>(value, "k_begin"), {}};
  const auto u = field<std::vector<Matrix>>(value, "u");
  const auto singular_values = field<std::vector<Vector>>(value, "singular_values");
  const auto scale = field<Vector>(value, "scale"), error = field<Vector>(value, "error");
  for (size_t s = 0; s < u.size(); ++s)
    factors.step.push_back({u[s], singular_values[s], scale(Index(s)), error(Index(s))});
  return factors;
}

// A model as the stages make it: `data` and D = 0 without feedthrough are noted.
Model noted(Model model, const Ensemble& data, bool feedthrough) {
  Provenance& provenance = model.provenance;
  note_data(provenance, fingerprint(data));
  provenance.experiments = data.experiments();
  provenance.dt_stated = data.dt_stated;
  provenance.feedthrough = {.present = feedthrough, .reason = FeedthroughChoice::Reason::stated};
  provenance.version = version;
  return model;
}

InitialState initial_state_of(const Ensemble& data) { return data.initial_state.value_or(InitialState::unknown); }

nb::dict regressed_each(const Ensemble& data, std::vector<Index> lags, bool feedthrough, double tolerance,
                        bool noise_shape, Index spent, int threads) {
  GtvArxOptions options;
  options.lags = std::move(lags);
  options.initial_state = initial_state_of(data);
  options.feedthrough = feedthrough;
  options.tolerance = tolerance;
  options.noise_shape = noise_shape;
  options.spent = spent;
  options.execution.threads = threads;
  return fields_of(without_gil([&] { return gtv_arx(data, options); }));
}

nb::dict regressed_together(const Ensemble& data, Index lags, double smoothing, Index period, bool feedthrough,
                            int threads) {
  const SmoothArxOptions options{lags, initial_state_of(data), feedthrough, {smoothing, period}, {threads, {}}};
  return fields_of(without_gil([&] { return smooth_arx(data, options); }));
}

nb::dict factorised(nb::handle parameters, Index rows, Index cols, const std::optional<AnyArray>& free_y,
                    const std::optional<Vector>& output_size, const std::optional<Vector>& input_size, int threads) {
  const MarkovFields given{parameters};
  TveraOptions options;
  options.rows = rows;
  options.cols = cols;
  options.output_size = output_size.value_or(Vector());
  options.input_size = input_size.value_or(Vector());
  options.execution.threads = threads;
  const FreeResponse free = free_y ? free_response_of(*free_y) : FreeResponse{};
  return fields_of(without_gil([&] { return hankel_factors(given.markov(), free, options); }), options);
}

Model realised(nb::handle parameters, nb::handle value, Index states, double noise_factor, int threads) {
  const MarkovFields given{parameters};
  const HankelFactors factors = factors_of(value);
  TveraOptions options;
  options.rows = factors.rows;
  options.cols = factors.cols;
  options.states = states;
  options.noise_factor = noise_factor;
  options.output_size = field<Vector>(value, "output_size");
  options.input_size = field<Vector>(value, "input_size");
  options.execution.threads = threads;
  return without_gil([&] {
    Model model = realise(given.markov(), factors, options);
    model.provenance.version = version;
    return model;
  });
}

Model with_regressions(const Model& model, const Ensemble& data, nb::handle value) {
  const ArxFields given{value};
  Plan plan;
  plan.initial_state = initial_state_of(data);
  return without_gil([&] {
    const GtvArx arx = given.regressions();
    return noted(completed(model, data, arx, plan), data, arx.feedthrough);
  });
}

Model subspace_model(const Ensemble& data, nb::handle value, Index states, Index future, Weighting weighting,
                     double smoothing, Index period, double state_smoothing,
                     const std::optional<Vector>& output_weights, bool noisy, int threads) {
  const ArxFields given{value};
  SubspaceOptions options;
  options.states = states;
  options.future = future;
  options.weighting = weighting;
  options.variation = {smoothing, period};
  options.state_smoothing = state_smoothing;
  options.output_weights = output_weights.value_or(Vector());
  options.noisy = noisy;
  options.execution.threads = threads;
  return without_gil([&] {
    const GtvArx arx = given.regressions();
    return noted(from_known_state(subspace(data, arx, options), initial_state_of(data)), data, arx.feedthrough);
  });
}

nb::tuple refined_by_em(const Model& model, const Ensemble& data, double smoothing, std::optional<Index> period,
                        Index iterations, double tolerance, bool feedthrough, std::vector<Index> jumps,
                        bool estimate_matrices, bool accelerate, bool warm_up, int threads) {
  RefineOptions options;
  options.initial_state = data.initial_state;
  options.smoothing = smoothing;
  options.period = period;
  options.iterations = iterations;
  options.tolerance = tolerance;
  options.feedthrough = feedthrough;
  options.jumps = std::move(jumps);
  options.estimate_matrices = estimate_matrices;
  options.accelerate = accelerate;
  options.warm_up = warm_up;
  options.execution.threads = threads;
  Refinement s = without_gil([&] {
    Refinement found = refine(model, data, options);
    note_data(found.model.provenance, fingerprint(data));
    found.model.provenance.refinement = {options.smoothing, found.iterations};
    found.model.provenance.version = version;
    return found;
  });
  const nb::dict fields = dict_of({FIELD(start_log_likelihood), FIELD(log_likelihood), FIELD(penalised),
                                   FIELD(iterations), FIELD(converged), FIELD(noise_segments), FIELD(findings)});
  return nb::make_tuple(std::move(s.model), fields);
}

void bind_regressions(nb::module_& module) {
  module.def("stage_windows", [](const Ensemble& data, Index k, Index lags) {
    return without_gil([&] { return Windows(data).rows(k, lags); });
  });
  module.def("stage_content_order",
             [](const Ensemble& data) { return without_gil([&] { return content_order(data); }); });
  module.def("stage_channel_sizes",
             [](const Ensemble& data) { return without_gil([&] { return Windows(data).channel_sizes(); }); });
  module.def("stage_gtv_arx", &regressed_each);
  module.def("stage_smooth_arx", &regressed_together);
}

void bind_realisations(nb::module_& module) {
  nb::enum_<Weighting>(module, "Weighting")
      .value("one_step", Weighting::one_step)
      .value("many_steps", Weighting::many_steps)
      .value("projection", Weighting::projection);
  module.def("stage_markov", [](nb::handle value, Index band, int threads) {
    const ArxFields given{value};
    return fields_of(without_gil([&] {
                       return markov(given.regressions(true), band, {threads, {}});
                     }),
                     given.noise_shape.has_value());
  });
  module.def("stage_hankel_factors", &factorised);
  module.def("stage_realise", &realised);
  module.def("stage_completed", &with_regressions);
  module.def("stage_subspace", &subspace_model);
  module.def("stage_with_nominal", [](Model model, Matrix u, Matrix y) {
    model.u_nominal = std::move(u);
    model.y_nominal = std::move(y);
    model.check();
    return model;
  });
}

}  // namespace

void bind_stages(nb::module_& module) {
  bind_regressions(module);
  bind_realisations(module);
  module.def("stage_refine", &refined_by_em);
}

}  // namespace tokid::python
