// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/stream.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "base/integers.hpp"
#include "base/statistics.hpp"
#include "diagnose/model_states.hpp"
#include "identify/identify.hpp"
#include "large/blocks.hpp"
#include "large/decide.hpp"
#include "large/reader.hpp"
#include "model/archived.hpp"

namespace tokid {

namespace {

using stream::BlockLayout;
using stream::BlockResult;
using stream::FinishedBlock;

// Memory of a block relative to that of its samples: the samples, intermediate results of twice their size, and the
// samples of the next block.
constexpr double memory_per_sample = 4.0;
constexpr Index longest_block = 4096;
// If steps are coupled, the ends of a block affect the model over about this number of steps.
constexpr Index fading = 96;
// Number of blocks of each thread before the results are put in order. It limits the number of results in memory.
constexpr Index blocks_at_a_time = 4;

// Blocks of automatic length are a multiple of four, or of two, if this adds at most this share of steps to read. Two
// or four processes or threads then have equal shares of the blocks.
constexpr double most_added = 0.05;

Index shared_evenly(Index count, Index steps, Index overlap) {
  const double read = double(steps + count * overlap);
  for (const Index even : {4, 2}) {
    const Index more = ceil_div(count, even) * even;
    if (double((more - count) * overlap) <= most_added * read) return more;
  }
  return count;
}

BlockLayout layout_of(const EnsembleFile& file, const StreamOptions& options, Plan plan) {
  BlockLayout layout;
  const Index p = plan.lags;
  const TveraOptions hankel = tvera_options(plan, file.outputs());
  const Index rows = hankel.rows, cols = hankel.cols;
  layout.rows = rows;
  layout.before = p + cols + rows;
  layout.after = 2 * rows + 2;
  if (plan.coupled) {
    layout.before = std::max(layout.before, fading);
    layout.after = std::max(layout.after, fading);
  }
  layout.plan = std::move(plan);
  layout.hold_out = options.identify.hold_out;
  layout.steps = file.steps();
  const Index overlap = layout.before + layout.after;
  Index length = options.block;
  if (length == 0) {
    // With coupled steps, each step needs several triangular factors.
    const double width = layout.plan.coupled ? double((p + 1) * file.channels()) : 0.0;
    const double step =
        (double(file.experiments() * file.channels()) + width * width) * sizeof(double) * memory_per_sample;
    const Index fewest = (layout.plan.coupled ? 2 : 4) * overlap;
    length = std::max(fewest, Index(std::min(options.memory_per_thread / step, double(longest_block))));
  } else if (length < std::min(overlap, layout.steps)) {
    throw std::invalid_argument(fmt::format(
        "block: {} steps found, at least {} needed, because neighbouring blocks share this number of steps at lag "
        "order {}",
        length, overlap, p));
  }
  layout.count = ceil_div(layout.steps, length);
  if (options.block == 0) layout.count = shared_evenly(layout.count, layout.steps, overlap);
  return layout;
}

// Assembles the model of the whole record from the results of its blocks.
class Record {
 public:
  Record(const EnsembleFile& file, const BlockLayout& layout, ModelFile& model)
      : file_(file), layout_(layout), joint_(model) {}

  // Blocks may be added in any order: a block is used when all blocks before it have been used.
  void put(FinishedBlock block) {
    waiting_.emplace(block.number, std::move(block.result));
    for (auto next = waiting_.find(done_); next != waiting_.end(); next = waiting_.find(++done_)) {
      add(std::move(next->second));
      waiting_.erase(next);
    }
  }

  void finish(const StreamOptions& options, ModelFile& file, Streamed& streamed) {
    Identification& result = streamed.identification;
    joint_.finish();
    check_presence(samples_, file_.names(), file_.inputs(), file_.experiments() * file_.steps());
    check_magnitudes(samples_, file_.names(), file_.inputs());
    streamed.missing = samples_.missing;
    result.steps = file_.steps();
    result.experiments = experiments();
    result.held_out = layout_.hold_out > 0;
    result.held_out_experiments = file_.experiments() - result.experiments;
    const Plan& plan = layout_.plan;
    result.min_experiments = minimum_experiments(file_.inputs(), file_.outputs(), plan.lags, plan.feedthrough.present) +
                             (plan.nominal ? 1 : 0);
    result.singular_value_gap = statistics::median(std::move(gaps_));
    result.condition_max = regressions_.condition_max;
    result.rank_deficient_steps = regressions_.rank_deficient;
    Validation of_first_steps = std::exchange(result.validation, {});
    result.validation.outlying = std::move(of_first_steps.outlying);
    result.validation.noisy = layout_.plan.noisy;
    result.validation.one_step = result.validation.horizon = fit_of(errors_.one_step, plan.nominal);
    result.validation.simulation = fit_of(errors_.simulation, plan.nominal);
    result.validation.whiteness_p = whiteness_p_;
    report(result, file.outline());

    Provenance origin = origin_of(options.identify, true, result);
    origin.data = {fingerprint(result.experiments, file_.inputs(), file_.outputs(), digests_)};
    origin.dt_stated = file_.dt_stated();
    file.commit(std::move(origin));
    result.model = file.outline();
  }

 private:
  void add(BlockResult block) {
    samples_.append(block.samples, block.begin);
    regressions_.append(block.regressions, block.read_begin);
    errors_.add(block.errors);
    digests_.insert(digests_.end(), block.digests.begin(), block.digests.end());
    gaps_.insert(gaps_.end(), block.gaps.begin(), block.gaps.end());
    if (!std::isnan(block.whiteness_p)) whiteness_p_ = block.whiteness_p;
    joint_.add(std::move(block));
  }

  Index experiments() const {
    const Index held = layout_.hold_out > 0 ? std::llround(layout_.hold_out * double(file_.experiments())) : 0;
    return file_.experiments() - held;
  }

  // A finding about all steps replaces those of the same kind about the first steps.
  void report(Identification& result, const Model& model) const {
    Findings of_all;
    const auto add = [&of_all](Findings more) { append(of_all, std::move(more)); };
    add(findings_of_inputs(samples_, file_.names()));
    add(findings_of_outputs(samples_, file_.names()));
    if (layout_.plan.coupled) {
      add(findings_of_absence(samples_, file_.names()));
    } else {
      const Index spent = layout_.plan.nominal ? 1 : 0;
      add(findings_of(regressions_,
                      {result.experiments, result.experiments - spent, file_.inputs(), file_.outputs(),
                       layout_.plan.lags, layout_.plan.feedthrough.present},
                      layout_.plan.noisy));
      if (!layout_.plan.noisy && regressions_.noisy()) add({{.kind = Finding::Kind::exact_first_steps}});
    }
    add(findings_of_absent_states(model));
    add(findings_of_begin(model));
    add(findings_of_gains(model));
    add(findings_of_fit(result.validation.one_step.fit, file_.names()));
    std::erase_if(result.findings, [&](const Finding& first) {
      return first.scope == Finding::Scope::first_steps &&
             std::any_of(of_all.begin(), of_all.end(), [&](const Finding& all) { return all.kind == first.kind; });
    });
    append(result.findings, std::move(of_all));
  }

  const EnsembleFile& file_;
  const BlockLayout& layout_;
  stream::Joint joint_;
  std::map<Index, BlockResult> waiting_;
  Index done_ = 0;  // number of blocks that have been used
  Survey samples_;
  RegressionSurvey regressions_;
  ErrorTotals errors_;
  std::vector<std::uint64_t> digests_;
  std::vector<double> gaps_;
  double whiteness_p_ = std::numeric_limits<double>::quiet_NaN();
};

// Identifies the blocks, shared among the processes of the team. The first process has the record and gets the blocks
// of all processes.
void identify_blocks(const EnsembleFile& file, const BlockLayout& layout, const StreamOptions& options,
                     std::optional<Record>& record) {
  const Team& team = options.team;
  std::vector<Index> share;
  for (Index i = team.rank; i < layout.count; i += team.size) share.push_back(i);
  const Index threads = thread_count(options.identify.execution), round = blocks_at_a_time * threads * team.size;
  stream::Reader reader(file, layout, share, threads);
  for (Index from = 0; from < layout.count; from += round) {
    const Index to = std::min(layout.count, from + round);
    std::vector<FinishedBlock> own(size_t(std::max<Index>(0, ceil_div(to - from - team.rank, team.size))));
    parallel_for(0, Index(own.size()), {int(threads), {}}, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) {
        const Index block = from + i * team.size + team.rank;
        own[size_t(i)] = {block, stream::identify_block(reader.take(block), layout, block)};
      }
    });
    const std::vector<std::string> all = team.gather(archive::packed(own));
    if (!record) continue;
    for (const std::string& member : all)
      for (FinishedBlock& block : archive::unpacked<std::vector<FinishedBlock>>(member)) record->put(std::move(block));
    if (options.identify.execution.progress)
      options.identify.execution.progress({.share = double(to) / double(layout.count)});
  }
}

}  // namespace

Streamed identify_stream(const EnsembleFile& file, const std::filesystem::path& path, const StreamOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const Team& team = options.team;
  std::optional<ModelFile> model;
  if (team.rank == 0) model.emplace(path);
  if (file.inputs() == 0) throw std::invalid_argument("ensemble: 0 inputs found, at least one needed");
  stream::Decision decision;
  if (team.rank == 0) decision = stream::decide(file, options.identify);
  // All processes use the plan of the first process.
  const std::string plan = team.broadcast(archive::packed(decision.plan));
  const BlockLayout layout = layout_of(file, options, archive::unpacked<Plan>(plan));
  std::optional<Record> record;
  if (model) record.emplace(file, layout, *model);
  identify_blocks(file, layout, options, record);
  Streamed result;
  result.identification = std::move(decision.evidence);
  result.block = layout.longest();
  result.blocks = layout.count;
  result.overlap = layout.before + layout.after;
  if (record) record->finish(options, *model, result);
  result.identification.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

}  // namespace tokid
