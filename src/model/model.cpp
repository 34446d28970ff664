// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "model/delays.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// With more steps or lags, sums of them would not be numbers of steps, or windows would not fit into memory.
constexpr Index most_steps = Index{1} << 52, most_lags = 1'000'000;

// Checks the number of names. An empty list is allowed.
void check_names(const char* name, const std::vector<std::string>& names, Index needed) {
  if (!names.empty() && Index(names.size()) != needed)
    throw std::invalid_argument(fmt::format("model: {} entries of {} found, {} needed", names.size(), name, needed));
}

constexpr std::pair<const char*, bool (Step::*)() const> besides[] = {{"innovation_cov", &Step::has_innovation_cov},
                                                                      {"Q", &Step::has_Q},
                                                                      {"R", &Step::has_R},
                                                                      {"K", &Step::has_K},
                                                                      {"singular_values", &Step::has_singular_values},
                                                                      {"condition", &Step::has_condition},
                                                                      {"rank", &Step::has_rank},
                                                                      {"lags", &Step::has_lags}};

void check_step(const Model& model, Index s) {
  const Step& step = model.step[size_t(s)];
  if (!step.has_matrices()) throw std::invalid_argument(fmt::format("model: step {} has no matrices", s));
  if (step.inputs() != model.inputs || step.outputs() != model.outputs)
    throw std::invalid_argument(fmt::format("model: step {} has {} inputs and {} outputs, {} and {} needed", s,
                                            step.inputs(), step.outputs(), model.inputs, model.outputs));
  if (s > 0 && step.states() != model.step[size_t(s) - 1].next_states())
    throw std::invalid_argument(fmt::format("model: A[{}] has {} columns, {} needed: the rows of A[{}]", s,
                                            step.states(), model.step[size_t(s) - 1].next_states(), s - 1));
  for (const auto& [name, has] : besides)
    if ((step.*has)() != model.has(has))
      throw std::invalid_argument(fmt::format(
          "model: {} is known at step {} or at step 0, but not at both. State it at every step or at none", name, s));
  if (step.has_lags() && (step.lags() < 0 || step.lags() > most_lags))
    throw std::invalid_argument(fmt::format("model: lags[{}] is {}, 0 to {} needed", s, step.lags(), most_lags));
  const auto finite = [&](const char* name, const Step::View& a) {
    if (!a.allFinite())
      throw std::invalid_argument(fmt::format("model: {}[{}] has a value that is not finite", name, s));
  };
  finite("A", step.A());
  finite("B", step.B());
  finite("C", step.C());
  finite("D", step.D());
  finite("G", step.G());
  if (step.has_innovation_cov()) finite("innovation_cov", step.innovation_cov());
  if (step.has_Q()) finite("Q", step.Q());
  if (step.has_R()) finite("R", step.R());
  if (step.has_K()) finite("K", step.K());
}

}  // namespace

Index Model::n(Index k) const {
  if (step.empty()) return 0;
  return k < k_end() ? at(k).states() : step.back().next_states();
}

Index Model::states() const {
  Index most = n(k_end());
  for (const Step& s : step) most = std::max(most, s.states());
  return most;
}

Index Model::full_begin() const {
  const Index full = states();
  Index k = k_begin;
  while (n(k) < full) ++k;
  return k;
}

Index Model::full_end() const {
  const Index full = states();
  Index k = full_begin();
  while (k <= k_end() && n(k) == full) ++k;
  return k;
}

Index Model::max_lags() const {
  Index most = 1;
  for (const Step& s : step)
    if (s.has_lags()) most = std::max(most, s.lags());
  return most;
}

void Model::check() const {
  if (inputs < 0) throw std::invalid_argument(fmt::format("model: {} inputs found, 0 or more needed", inputs));
  if (outputs < 1) throw std::invalid_argument(fmt::format("model: {} outputs found, 1 or more needed", outputs));
  if (k_begin < 0 || k_begin > most_steps)
    throw std::invalid_argument(fmt::format("model: first step {} found, 0 to {} needed", k_begin, most_steps));
  if (period < 0) throw std::invalid_argument(fmt::format("model: period {} found, 0 or more needed", period));
  if (!(dt > 0) || !std::isfinite(dt))
    throw std::invalid_argument(fmt::format("model: dt = {} found, a positive time in seconds needed", dt));
  check_names("input_names", names.input_names, inputs);
  check_names("output_names", names.output_names, outputs);
  check_names("input_units", names.input_units, inputs);
  check_names("output_units", names.output_units, outputs);
  for (Index s = 0; s < steps(); ++s) check_step(*this, s);
  if (ends_early(*this, k_end() + 1) && n(k_end()) != n(k_end() - period))
    throw std::invalid_argument(
        fmt::format("model: {} states found after step {}, {} needed: those of step {}, a period of {} steps before",
                    n(k_end()), k_end() - 1, n(k_end() - period), k_end() - period, period));
  const Index n0 = n(k_begin);
  if (x0_mean.size() > 0 && x0_mean.size() != n0)
    throw std::invalid_argument(
        fmt::format("model: x0_mean has {} entries, {} needed: the states of step {}", x0_mean.size(), n0, k_begin));
  if (x0_cov.size() > 0 && (x0_cov.rows() != n0 || x0_cov.cols() != n0))
    throw std::invalid_argument(fmt::format("model: x0_cov is {} x {}, {} x {} needed: the states of step {}",
                                            x0_cov.rows(), x0_cov.cols(), n0, n0, k_begin));
  if ((u_nominal.rows() > 0 || y_nominal.rows() > 0) &&
      (u_nominal.cols() != inputs || y_nominal.cols() != outputs || u_nominal.rows() != y_nominal.rows()))
    throw std::invalid_argument(fmt::format(
        "model: u_nominal is {} x {} and y_nominal {} x {}, equal numbers of rows (steps) with {} columns (inputs) and {} columns (outputs) needed",
        u_nominal.rows(), u_nominal.cols(), y_nominal.rows(), y_nominal.cols(), inputs, outputs));
  if (!u_nominal.allFinite() || !y_nominal.allFinite() || !x0_mean.allFinite() || !x0_cov.allFinite())
    throw std::invalid_argument("model: u_nominal, y_nominal, x0_mean or x0_cov has a value that is not finite");
}

bool ends_early(const Model& model, Index steps) {
  return model.period > 0 && model.steps() >= model.period && model.k_end() < steps;
}

Index estimation_window(const Model& model) {
  const std::vector<Index> delays = delays_of(model.provenance);
  const Index of_plant = std::max<Index>(0, model.states() - held_inputs(delays));
  return std::max(model.max_lags(), latest(delays) + ceil_div(of_plant, model.outputs));
}

Index unknowns(const Model& model, Index k) {
  if (!model.has(&Step::has_lags)) return 0;
  const Index through = has_feedthrough(model.provenance) ? model.inputs : 0;
  const bool on_windows = model.method == "tvera" || model.method == "regression";
  return through + (on_windows ? model.at(k).lags() * (model.inputs + model.outputs) : model.n(k));
}

bool starts_from_zero(const Model& model, InitialState initial) {
  return model.steps() > 0 && (model.n(model.k_begin) == 0 || (initial == InitialState::zero && model.k_begin == 0));
}

bool has_initial_estimate(const Model& model, InitialState initial) {
  const Index n = model.steps() > 0 ? model.n(model.k_begin) : 0;
  return n > 0 && initial == InitialState::unknown && model.initial_state == InitialState::unknown &&
         model.x0_mean.size() == n && model.x0_cov.rows() == n && model.x0_cov.cols() == n;
}

namespace {

// C_k A_{k-1} … A_{i+1} X_i
Matrix response(const Model& model, Index k, Index i, Step::View (Step::*entrance)() const) {
  if (i < model.k_begin || k <= i || k >= model.k_end())
    throw std::invalid_argument(fmt::format("pulse response: steps k = {}, i = {} found, {} <= i < k < {} needed", k, i,
                                            model.k_begin, model.k_end()));
  Matrix x = (model.at(i).*entrance)();
  for (Index j = i + 1; j < k; ++j) x = model.at(j).A() * x;
  return model.at(k).C() * x;
}

}  // namespace

Matrix pulse_response(const Model& model, Index k, Index i) { return response(model, k, i, &Step::B); }
Matrix gain_pulse_response(const Model& model, Index k, Index i) { return response(model, k, i, &Step::G); }

std::vector<Matrix> pulse_responses(const Model& model, Index band) {
  if (band < 1) throw std::invalid_argument(fmt::format("band: {} found, at least 1 needed", band));
  const Index r = model.inputs;
  std::vector<Matrix> result(model.step.size(), Matrix::Constant(model.outputs, band * r, nan));
  for (Index i = model.k_begin; i < model.k_end(); ++i) {
    checkpoint();
    Matrix x = model.at(i).B();
    for (Index k = i + 1; k < std::min(model.k_end(), i + 1 + band); ++k) {
      result[model.index(k)].middleCols((k - i - 1) * r, r).noalias() = model.at(k).C() * x;
      x = model.at(k).A() * x;
    }
  }
  return result;
}

Matrix observability(const Model& model, Index k, Index rows) {
  if (k < model.k_begin || k > model.k_end())
    throw std::invalid_argument(
        fmt::format("observability: step {} found, {} to {} needed", k, model.k_begin, model.k_end()));
  if (rows < 0) throw std::invalid_argument(fmt::format("observability: {} rows found, 0 or more needed", rows));
  const Index count = std::max<Index>(0, std::min(rows, model.k_end() - k));
  Matrix o(count * model.outputs, model.n(k));
  Matrix transition = Matrix::Identity(model.n(k), model.n(k));
  for (Index a = 0; a < count; ++a) {
    const size_t s = model.index(k + a);
    o.middleRows(a * model.outputs, model.outputs) = model.step[s].C() * transition;
    transition = model.step[s].A() * transition;
  }
  return o;
}

Model continued(Model model, Index end) {
  if (!ends_early(model, model.k_end() + 1)) return model;
  const size_t period = size_t(model.period);
  model.step.reserve(model.step.size() + size_t(std::max<Index>(0, end - model.k_end())));
  for (Index k = model.k_end(); k < end; ++k) model.step.push_back(Step(model.step[model.step.size() - period]));
  for (Matrix* nominal : {&model.u_nominal, &model.y_nominal}) {
    const Index known = nominal->rows();
    if (known < model.period || known >= end) continue;
    nominal->conservativeResize(end, Eigen::NoChange);
    for (Index k = known; k < end; ++k) nominal->row(k) = Eigen::RowVectorXd(nominal->row(k - model.period));
  }
  return model;
}

void check_finite(const Model& model) {
  for (const Step& step : model.step)
    for (const Step::View& a : {step.A(), step.B(), step.C(), step.D(), step.G(),
                                step.has_innovation_cov() ? step.innovation_cov() : step.D()})
      if (!a.allFinite())
        throw std::overflow_error(
            "the model is not finite: samples or their ratios are beyond the range of double precision; scale the "
            "data");
}

}  // namespace tokid
