// SPDX-License-Identifier: BSD-3-Clause
#include "large/decide.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <optional>
#include <stdexcept>
#include <type_traits>

#include "choose/feedthrough.hpp"
#include "choose/realisation.hpp"
#include "data/axes.hpp"
#include "data/channel_sizes.hpp"
#include "diagnose/excitation.hpp"
#include "diagnose/model_states.hpp"
#include "diagnose/outliers.hpp"
#include "diagnose/recording.hpp"
#include "identify/identify.hpp"
#include "large/choices_archive.hpp"
#include "large/finding_archive.hpp"
#include "model/options.hpp"
#include "tokid/dependence.hpp"
#include "tokid/remarks.hpp"
#include "tokid/subspace.hpp"

namespace tokid::stream {

namespace {

// The size of a stretch in memory [bytes], and its fewest and most steps.
constexpr double stretch_bytes = 16e6;
constexpr Index fewest_steps = 160, most_steps = 512;
// λ if the stretches show no variation over time. It is finite, because the system may still vary slowly over the whole
// record.
constexpr double stiff = 1e3;

void check(const IdentifyOptions& o) {
  const auto refuse = [](const char* what, const std::string& found, const char* remedy) {
    throw std::invalid_argument(
        fmt::format("{}: {} found, which needs all steps at once. To identify in blocks, {}", what, found, remedy));
  };
  if (o.period > 0) refuse("period", std::to_string(o.period), "state no period");
  if (o.smoothing && std::isinf(*o.smoothing)) refuse("smoothing", "infinity", "state a finite smoothing");
  if (o.jumps && !o.jumps->empty()) refuse("jumps", std::to_string(o.jumps->front()), "state no jumps");
  if (o.delays && !o.delays->empty()) refuse("delays", find_option("delays")->write(o).dump(), "state no delays");
  if (o.outliers != OutlierChoice::keep)
    refuse("outliers", find_option("outliers")->write(o).get<std::string>(),
           "use outliers keep: tokid then names the outliers and keeps them");
  if (o.frame == Frame::reference) refuse("frame", "reference", "use the frame raw or smooth");
}

struct Part {
  Index begin = 0;
  Ensemble whole;                 // all experiments of the stretch
  std::optional<Ensemble> fewer;  // without those that are held out, if there are any
  const Ensemble& training() const { return fewer ? *fewer : whole; }
};

// Stretches of the record: their first steps, and the number of steps that each of them has.
struct Stretches {
  std::vector<Index> begins;
  Index length = 0;
};

Stretches stretches(const EnsembleFile& file, const IdentifyOptions& o) {
  const double step = double(file.experiments() * file.channels()) * sizeof(double);
  const Index total = file.steps();
  Stretches result{
      {0},
      std::min(total, std::max(Index(std::clamp(stretch_bytes / step, double(fewest_steps), double(most_steps))),
                               8 * o.lags.value_or(0)))};
  const Index length = result.length;
  for (const Index begin : {(total - length) / 2, total - length})
    if (begin >= length / 2 + result.begins.back()) result.begins.push_back(begin);
  return result;
}

// The samples of the stretches. The first member of the team examines all stretches. The other members read only the
// stretches that they identify, and their other parts are empty.
std::vector<Part> parts_of(const EnsembleFile& file, const Stretches& stretches, double hold_out, const Team& team) {
  std::vector<Index> wanted;
  for (Index i = 0; i < Index(stretches.begins.size()); ++i)
    if (team.rank == 0 || i % team.size == team.rank) wanted.push_back(i);
  const auto begin = [&](Index i) { return stretches.begins[size_t(i)]; };
  for (const Index i : wanted) file.expect(begin(i), begin(i) + stretches.length);
  std::vector<Part> result(stretches.begins.size());
  for (const Index i : wanted) {
    Part& part = result[size_t(i)];
    part.begin = begin(i);
    part.whole = file.read(begin(i), begin(i) + stretches.length);
    part.whole.free = {};
    if (hold_out > 0) part.fewer = split(part.whole, hold_out).training;
  }
  return result;
}

// Joins stretches of the same length to one ensemble, one after the other in time.
Ensemble in_a_row(const std::vector<const Ensemble*>& stretches) {
  const Ensemble& first = *stretches.front();
  const Index width = first.samples().cols(), count = Index(stretches.size());
  Ensemble all(first.experiments(), first.steps() * count, first.inputs(), first.outputs());
  for (Index i = 0; i < count; ++i) all.samples().middleCols(i * width, width) = stretches[size_t(i)]->samples();
  return all;
}

// Tests the mean motion in one test over the steps of all stretches. The error probability therefore does not depend on
// the number of stretches.
NominalTest test_nominal(const std::vector<Part>& parts) {
  std::vector<const Ensemble*> stretches;
  for (const Part& part : parts) stretches.push_back(&part.training());
  NominalTest test = tokid::test_nominal(in_a_row(stretches));
  for (NominalTest::Departure& departure : test.departures)
    for (Index& k : departure.steps) {
      const Index length = parts.front().training().steps();
      k = parts[size_t(k / length)].begin + k % length;
    }
  return test;
}

// What a stretch tells about single experiments and about channels that cannot be separated.
struct Examined {
  Findings findings;
  std::vector<Index> stuck;  // experiments with an output that stays constant
  std::vector<Outlier> outliers;
};

template <class Archive, class E>
requires std::is_same_v<std::remove_const_t<E>, Examined>
void fields(Archive& archive, E& e) { archive(e.findings, e.stuck, e.outliers); }

// `found`: the identification of the stretch; empty if it failed. `plan`: that of all blocks. `steps`: of the data.
Examined examined(const Part& part, const std::optional<Identification>& found, const Plan& plan, bool states_asked,
                  Index steps) {
  Examined result;
  const Ensemble& whole = part.whole;
  append(result.findings, findings_of_dependent_outputs(whole, part.begin));
  append(result.findings, findings_of_recording(whole, part.begin, part.begin + whole.steps() == steps));
  StuckOutputs stuck = stuck_outputs(whole, part.begin);
  result.stuck = std::move(stuck.experiments);
  append(result.findings, std::move(stuck.findings));
  append(result.findings,
         excitation(whole, {.lags = plan.lags, .noisy = plan.noisy, .shared = plan.coupled, .origin = part.begin})
             .findings);
  if (states_asked && found) append(result.findings, findings_of_hidden_states(found->model, part.begin));
  const OutlierOptions o{.lags = plan.lags,
                         .nominal = plan.nominal,
                         .zero_start = found && found->model.initial_state == InitialState::zero,
                         .period = plan.choices.variation.period,
                         .model = found ? &found->model : nullptr};
  result.outliers = plan.noisy ? outliers(whole, o) : outliers_without_noise(whole, o);
  return result;
}

// Examines the stretches. Each member of the team examines those that it has identified. Only the first member has the
// plan, and gets what all stretches tell.
std::vector<Examined> examined(const std::vector<Part>& parts, const std::vector<std::optional<Identification>>& found,
                               const Plan& of_first, bool states_asked, Index steps, const Team& team) {
  const auto plan = archive::unpacked<Plan>(team.broadcast(archive::packed(of_first)));
  std::map<Index, Examined> mine;
  for (size_t i = size_t(team.rank); i < parts.size(); i += size_t(team.size))
    mine.emplace(Index(i), examined(parts[i], found[i], plan, states_asked, steps));
  std::vector<Examined> result(parts.size());
  for (const std::string& member : team.gather(archive::packed(mine)))
    for (auto& [i, own] : archive::unpacked<std::map<Index, Examined>>(member)) result[size_t(i)] = std::move(own);
  return result;
}

// Reports what the stretches tell, each finding once, and the worst ratio of each outlier.
void report(const std::vector<Part>& parts, std::vector<Examined> of_stretches, Identification& result) {
  Findings findings;
  std::vector<Index> stuck;
  const auto add = [&findings](Findings more) {
    for (Finding& finding : more)
      if (std::none_of(findings.begin(), findings.end(),
                       [&](const Finding& other) { return same_words(other, finding); }))
        findings.push_back(std::move(finding));
  };
  for (Examined& own : of_stretches) {
    add(std::move(own.findings));
    stuck.insert(stuck.end(), own.stuck.begin(), own.stuck.end());
  }

  std::vector<const Ensemble*> stretches;
  for (const Part& part : parts) stretches.push_back(&part.whole);
  const Ensemble& first = parts.front().whole;
  result.copies = find_copies(in_a_row(stretches));
  add(findings_of(result.copies, first));
  result.dependent = dependence_beside(result.copies, first);
  add(findings_of(result.dependent, first));

  for (Examined& stretch : of_stretches)
    for (Outlier& own : stretch.outliers) {
      const auto same = std::find_if(result.outliers.begin(), result.outliers.end(),
                                     [&](const Outlier& other) { return other.experiment == own.experiment; });
      if (same == result.outliers.end())
        result.outliers.push_back(std::move(own));
      else if (same->ratio < own.ratio)
        *same = std::move(own);
    }
  add(findings_of(result.outliers, stuck));
  for (Finding& finding : findings) finding.scope = Finding::Scope::deciding_stretches;
  append(result.findings, std::move(findings));
}

// Does stretch a need a larger model than stretch b?
bool demands_more(const Identification& a, const Identification& b) {
  if (a.plan.coupled != b.plan.coupled) return a.plan.coupled;
  if (a.model.states() != b.model.states()) return a.model.states() > b.model.states();
  return a.plan.lags > b.plan.lags;
}

// Identifies a stretch after the first one. Only the first stretch begins at step 0, so the initial states are unknown
// in the others. Empty for a stretch with too few samples for a decision.
std::optional<Identification> later_stretch(const Ensemble& data, IdentifyOptions options, std::optional<Index> lags) {
  options.initial_state = InitialState::unknown;
  if (lags) options.lags = lags;
  try {
    return identify_part(data, options, false);
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

// Identifies the stretches, shared among the processes of the team: member i identifies the stretches i, i + size, …
// The first member gets the results for all stretches; empty for a stretch with too few samples for a decision.
std::vector<std::optional<Identification>> identified(const std::vector<Part>& parts, const IdentifyOptions& options,
                                                      const Team& team) {
  const Index count = Index(parts.size());
  std::vector<std::optional<Identification>> result(parts.size());
  std::optional<Index> exact_lags;
  // A member that has no part in the first stretch begins with its own search for the lag order. It needs this search
  // if there is noise. Without noise, the time is lost in which it would wait for the first stretch.
  const bool searches = team.rank > 0 && team.rank < count;
  std::optional<Identification> searched;
  std::exception_ptr failed;
  if (team.rank == 0) {
    result.front() = with_remark_on_axes(parts.front().whole,
                                         [&] { return identify_part(parts.front().training(), options, false); });
    const Plan& first = result.front()->plan;
    if (!first.noisy && !first.coupled && !options.lags) exact_lags = first.lags;
  } else if (searches) {
    try {
      searched = later_stretch(parts[size_t(team.rank)].training(), options, {});
    } catch (const std::runtime_error&) {
      failed = std::current_exception();  // matters only if the search was needed
    }
  }
  // If a lag order is exact in the first stretch, it is probably exact in the others. This saves their searches.
  exact_lags = archive::unpacked<std::optional<Index>>(team.broadcast(archive::packed(exact_lags)));
  for (Index i = team.rank == 0 ? team.size : team.rank; i < count; i += team.size) {
    const Ensemble& data = parts[size_t(i)].training();
    std::optional<Identification>& own = result[size_t(i)];
    if (exact_lags) own = later_stretch(data, options, exact_lags);
    if (exact_lags && !(own && own->plan.noisy)) continue;
    if (i == team.rank && failed) std::rethrow_exception(failed);
    own = searches && i == team.rank ? std::move(searched) : later_stretch(data, options, {});
  }
  if (team.size == 1) return result;
  std::map<Index, Identification> mine;
  for (Index i = team.rank == 0 ? count : team.rank; i < count; i += team.size)
    if (result[size_t(i)]) mine.emplace(i, *result[size_t(i)]);
  const std::vector<std::string> all = team.gather(archive::packed(mine));
  for (size_t member = 1; member < all.size(); ++member)
    for (auto& [i, own] : archive::unpacked<std::map<Index, Identification>>(all[member]))
      result[size_t(i)] = std::move(own);
  return result;
}

// Do the stretches show no variation over time?
bool is_constant(const Plan& plan) { return plan.coupled && plan.choices.variation.period > 0; }

// The plan for all blocks: the plan of the stretch `chosen`, with noise and coupling if any stretch has them.
Plan joint_plan(const std::vector<const Identification*>& found, const Identification& chosen,
                const IdentifyOptions& options, const std::vector<Part>& parts) {
  Plan plan = chosen.plan;
  for (const Identification* own : found) {
    plan.noisy = plan.noisy || own->plan.noisy;
    plan.coupled = plan.coupled || own->plan.coupled;
    const bool doubtful = own->plan.feedthrough.reason == FeedthroughChoice::Reason::feedback;
    if (doubtful || (own->plan.feedthrough.present && !plan.feedthrough.present))
      plan.feedthrough = own->plan.feedthrough;
  }
  plan.initial_state = found.front()->model.initial_state;
  plan.method = options.method.value_or(automatic_method(plan));
  plan.frame = options.frame;
  if (!plan.noisy)
    for (const Identification* own : found) plan.lags = std::max(plan.lags, own->plan.lags);
  plan.states = options.states.value_or(plan.noisy ? chosen.model.states() : 0);
  plan.output_size = Vector::Zero(parts.front().training().outputs());
  plan.input_size = Vector::Zero(parts.front().training().inputs());
  const auto take_larger = [&](const Ensemble& e) {
    plan.output_size = plan.output_size.cwiseMax(channel_sizes(e, e.inputs(), e.outputs()));
    plan.input_size = plan.input_size.cwiseMax(channel_sizes(e, 0, e.inputs()));
  };
  for (const Part& part : parts)
    if (plan.nominal)
      take_larger(departures(part.training(), nominal_trajectory(part.training())));
    else
      take_larger(part.training());
  return plan;
}

// The plan for all blocks and its evidence, from the identifications of the stretches. \throws as joint_plan()
Decision joint_decision(const EnsembleFile& file, const std::vector<std::optional<Identification>>& of_stretches,
                        const IdentifyOptions& options, const std::vector<Part>& parts) {
  std::vector<const Identification*> found;
  for (const auto& own : of_stretches)
    if (own) found.push_back(&*own);
  const Identification* chosen = found.front();
  for (const Identification* own : found)
    if (demands_more(*own, *chosen)) chosen = own;

  Decision result;
  result.plan = joint_plan(found, *chosen, options, parts);
  result.evidence = *chosen;
  result.evidence.initial_state_test = found.front()->initial_state_test;
  result.evidence.findings = remarks(parts.front().whole);
  if (is_constant(result.plan))
    result.evidence.findings.push_back({.kind = Finding::Kind::constant_stretches, .numbers = {{"smoothing", stiff}}});
  append(result.evidence.findings, findings_of(result.plan.feedthrough, file.names()));
  return result;
}

}  // namespace

Decision decide(const EnsembleFile& file, const IdentifyOptions& options, const Team& team) {
  check(options);
  std::vector<Part> parts = parts_of(file, stretches(file, options), options.hold_out, team);
  IdentifyOptions o = options;
  o.hold_out = 0.0;
  o.frame = Frame::raw;
  o.jumps = std::vector<Index>{};  // the steps of a stretch are not those of the blocks
  o.delays = std::vector<Index>{};
  o.execution.progress = {};

  NominalTest nominal;
  if (!options.nominal) {
    if (team.rank == 0) nominal = test_nominal(parts);
    const bool significant = archive::unpacked<bool>(team.broadcast(archive::packed(nominal.significant)));
    o.nominal = significant ? NominalChoice::mean : NominalChoice::none;
  }
  const std::vector<std::optional<Identification>> of_stretches = identified(parts, o, team);
  Decision result;
  if (team.rank == 0) result = joint_decision(file, of_stretches, options, parts);
  std::vector<Examined> told =
      examined(parts, of_stretches, result.plan, options.states.has_value(), file.steps(), team);
  if (team.rank > 0) return {};
  report(parts, std::move(told), result.evidence);
  if (is_constant(result.plan)) result.plan.choices = NoisyChoices{{stiff, 0}, SubspaceOptions::state_share * stiff};
  result.evidence.nominal_test = std::move(nominal);
  result.evidence.plan = result.plan;
  return result;
}

}  // namespace tokid::stream
