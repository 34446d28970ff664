// SPDX-License-Identifier: BSD-3-Clause
#include "large/blocks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <stdexcept>

#include "choose/realisation.hpp"
#include "diagnose/model_states.hpp"
#include "model/archived.hpp"
#include "model/coordinates.hpp"

namespace tokid::stream {

namespace {

// The steps from … to-1 of the model of a stretch. `origin`: the step of the record at which the stretch begins.
Model excerpt(const Model& model, Index from, Index to, Index origin) {
  Model part = from_step(model, from);
  part.step.resize(size_t(std::min(to - from, part.steps())));
  part.k_begin = origin + from;
  return part;
}

// Changes the coordinates of all steps to x' = Rᵀ x, where R = `r` is orthogonal.
void rotate(Model& model, const Matrix& r) {
  const Matrix back = r.transpose();
  for (size_t s = 0; s < model.step.size(); ++s) {
    model.step[s].A() = back * model.step[s].A() * r;
    model.step[s].B() = back * model.step[s].B();
    model.step[s].C() = model.step[s].C() * r;
    model.step[s].G() = back * model.step[s].G();
    if (model.has(&Step::has_Q)) model.step[s].set_Q(back * model.step[s].Q() * r);
    if (model.has(&Step::has_K)) model.step[s].set_K(back * model.step[s].K());
  }
}

bool same_dimension(const Model& model) {
  return std::all_of(model.step.begin(), model.step.end(), [n = model.n(model.k_begin)](const Step& step) {
    return step.states() == n && step.next_states() == n;
  });
}

void append_digests(const Ensemble& data, Index begin, Index end, std::vector<std::uint64_t>& digests) {
  for (Index k = begin; k < end; ++k) digests.push_back(digest(data, k));
}

double whiteness_of(const Model& model, const Ensemble& data, InitialState initial) {
  ValidateOptions o;
  o.initial_state = initial;
  return validate(model, data, o).whiteness_p;
}

// Only the first block begins with the initial states of the experiments. The models of the other blocks begin at their
// first regression, because the block before contains the earlier steps.
Plan plan_of(const BlockLayout& layout, bool first) {
  Plan plan = layout.plan;
  plan.from_full_dimension = first;
  if (!first) plan.initial_state = InitialState::unknown;
  return plan;
}

// `begin` … `end`-1: the steps of the survey, which is made only if each step has its own regression.
Model model_of(const Ensemble& departures, const Plan& plan, Index begin, Index end, RegressionSurvey& survey) {
  const Execution execution{1, {}};
  GtvArx arx = regressed_as(departures, plan, execution);
  if (!plan.coupled) {
    survey = survey_of(arx, plan.nominal, begin, end);
    survey.unexcited = unexcited_steps(departures, arx, plan.nominal, std::max(begin, plan.lags), end);
  }
  Model model = in_frame(realised_as(departures, std::move(arx), plan, execution), plan).model;
  check_finite(model);
  return model;
}

}  // namespace

Block BlockLayout::block(Index i) const {
  const Index begin = steps * i / count, end = steps * (i + 1) / count;
  return {std::max<Index>(0, begin - before), begin, end, std::min(steps, end + after)};
}

BlockResult identify_block(Ensemble data, const BlockLayout& layout, Index i) {
  const Block block = layout.block(i);
  const bool first = block.first == 0;
  const Index begin = block.begin - block.first, end = block.end - block.first;
  BlockResult result;
  result.begin = block.begin;
  result.read_begin = block.first;
  Ensemble held_out;
  // Surveys and digests read `together` steps at a time, which fit into the second cache level.
  const Index together = std::max<Index>(1, (Index{1} << 16) / (data.experiments() * data.channels()));
  for (Index k = begin; k < end; k += together) {
    const Index to = std::min(end, k + together);
    result.samples.append(survey(data, k, to, block.first), k - begin);
    if (layout.hold_out == 0) append_digests(data, k, to, result.digests);
  }
  if (layout.hold_out > 0) {
    Split parts = split(data, layout.hold_out);
    data = std::move(parts.training);
    held_out = std::move(parts.held_out);
    held_out.free = {};
    append_digests(data, begin, end, result.digests);
  }
  const Plan plan = plan_of(layout, first);
  std::optional<Nominal> nominal;
  if (plan.nominal) {
    nominal = nominal_trajectory(data);
    data = departures(std::move(data), *nominal);
    data.free = free_departures(data.free);
  }
  Model model = model_of(data, plan, begin, end, result.regressions);
  const Index from = std::max(begin, model.k_begin);
  if ((i > 0 ? from > begin : from >= end) || model.k_end() < end)
    throw std::invalid_argument(
        fmt::format("steps: {} to {} are too few to identify a model at their {}, longer blocks needed", block.begin,
                    block.end - 1, from > begin ? "begin" : "end"));
  if (layout.hold_out > 0 && nominal) held_out = departures(std::move(held_out), *nominal);
  const Ensemble& tested = layout.hold_out > 0 ? held_out : data;
  result.errors = evaluate(model, tested, begin, end, plan.initial_state, i == 0);
  if (layout.plan.noisy && i == layout.count / 2) result.whiteness_p = whiteness_of(model, tested, plan.initial_state);

  result.opening = observability(model, from, layout.rows);
  if (block.end < layout.steps) result.closing = observability(model, end, layout.rows);
  result.model = excerpt(model, from, end, block.first);
  result.model.initial_state = layout.plan.initial_state;
  result.gaps = singular_value_gaps(result.model);
  if (i > 0) {  // mean and covariance of the state at step 0 of the record are those of the first block
    result.model.x0_mean.resize(0);
    result.model.x0_cov.resize(0, 0);
  }
  if (nominal) {
    result.model.u_nominal = nominal->u.middleRows(begin, end - begin);
    result.model.y_nominal = nominal->y.middleRows(begin, end - begin);
  }
  return result;
}

void Joint::add(BlockResult block) {
  Model& model = block.model;
  if (waiting_) {
    const bool smooth = model.frame == "smooth" && same_dimension(model) && block.opening.cols() == closing_.cols() &&
                        block.closing.cols() == (block.closing.size() > 0 ? closing_.cols() : 0);
    const Index rows = std::min(block.opening.rows(), closing_.rows());
    if (smooth && closing_.cols() > 0) {
      const Matrix r = linalg::procrustes(block.opening.topRows(rows), closing_.topRows(rows));
      rotate(model, r);
      block.opening = block.opening * r;
      if (block.closing.size() > 0) block.closing = block.closing * r;
    }
    lead_into(*waiting_, linalg::pseudo_inverse(block.opening.topRows(rows)) * closing_.topRows(rows));
    file_.append(*waiting_);
  }
  waiting_ = std::move(model);
  closing_ = std::move(block.closing);
}

void Joint::finish() {
  if (waiting_) file_.append(*waiting_);
  waiting_.reset();
}

}  // namespace tokid::stream
