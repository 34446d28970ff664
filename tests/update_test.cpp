// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <functional>
#include <iterator>
#include <limits>
#include <random>
#include <thread>

#include "base/archive.hpp"
#include "io/formats/provenance_text.hpp"
#include "large/plan_archive.hpp"
#include "members.hpp"
#include "testing.hpp"
#include "tokid/io.hpp"

namespace tokid {
namespace {

using testing::epsilon;
using testing::message;
using testing::Random;
using testing::random_experiments;
using testing::random_system;
using testing::range;
using testing::Threads;
using testing::with_noise;

struct UpdateCase {
  const char* name = nullptr;
  double noise = 0.0, initial = 0.0, offset = 0.0;
  bool gaps = false;
  IdentifyOptions options = {};
};

double difference(const Model& a, const Model& b) {
  EXPECT_EQ(a.k_begin, b.k_begin);
  EXPECT_EQ(testing::state_dims(a), testing::state_dims(b));
  double largest = 0.0, size = 0.0;
  for (Index i = a.k_begin; i + 1 < a.k_end(); ++i) {
    EXPECT_LE((a.at(i).D() - b.at(i).D()).norm(), 1e-10 * (1 + b.at(i).D().norm()));
    for (Index k = i + 1; k < std::min(a.k_end(), i + 12); ++k) {
      const Matrix x = pulse_response(a, k, i), y = pulse_response(b, k, i);
      largest = std::max(largest, (x - y).norm());
      size = std::max(size, y.norm());
    }
  }
  return largest / size;
}

// In three portions or all at once: the same model, in every way to come by one.
TEST(Update, IsTheIdentificationOfAllExperiments) {
  std::vector<UpdateCase> cases(12);
  cases[0].name = "noise-free";
  cases[1].name = "unknown initial states";
  cases[1].initial = 5.0;
  cases[2].name = "mean motion";
  cases[2].offset = 3.0;
  cases[2].options.nominal = NominalChoice::mean;
  cases[3].name = "noise, each step by itself";
  cases[3].noise = 0.05;
  cases[3].options.method = Method::tvera;
  cases[3].options.states = 3;
  cases[3].options.lags = 3;
  cases[4].name = "noise, lambda = 1";
  cases[4].noise = 0.05;
  cases[4].options.choices = NoisyChoices{{1.0, 0}, 0.1, Weighting::one_step, 0.0, 0};
  cases[4].options.smoothing = 1.0;
  cases[4].options.states = 3;
  cases[4].options.lags = 3;
  cases[4].options.refine = false;
  cases[5].name = "noise, one model";
  cases[5].noise = 0.05;
  cases[5].options.period = 1;
  cases[5].options.choices = NoisyChoices{{0.0, 1}, 0.0, Weighting::many_steps, 0.0, 0};
  cases[5].options.states = 3;
  cases[5].options.lags = 3;
  cases[5].options.refine = false;
  cases[6] = cases[4];
  cases[6].name = "noise, lambda = 1, gaps, unknown initial states, mean motion";
  cases[6].gaps = true;
  cases[6].initial = 2.0;
  cases[6].offset = 1.0;
  cases[6].options.initial_state = InitialState::unknown;
  cases[6].options.nominal = NominalChoice::mean;
  cases[7] = cases[5];
  cases[7].name = "noise, one model, mean motion";
  cases[7].offset = 1.0;
  cases[7].options.nominal = NominalChoice::mean;
  cases[8].name = "lambda = 1 without noise, choices of its own";
  cases[8].options.refine = false;
  cases[8].options.smoothing = 1.0;
  cases[8].options.lags = 2;
  cases[9].name = "many steps, one model without noise";
  cases[9].options.period = 1;
  cases[9].options.lags = 3;
  cases[9].options.weighting = Weighting::many_steps;
  cases[9].options.refine = false;
  for (const size_t i : {4u, 5u}) {
    UpdateCase& regression = cases[6 + i] = cases[i];
    regression.options.method = Method::regression;
    regression.options.states.reset();
    regression.options.choices->weighting = Weighting::one_step;
  }
  cases[10].name = "noise, lambda = 1, the regression";
  cases[11].name = "noise, one model, the regression";
  for (const UpdateCase& c : cases) {
    SCOPED_TRACE(c.name);
    const Model truth = random_system({3, 2, 2}, 24, 1.0, 7);
    Ensemble e = random_experiments(truth, 60, 8, c.initial);
    if (c.noise > 0) e = with_noise(e, c.noise, 9);
    Random random(10);
    for (Index k = 0; c.offset > 0 && k < 24; ++k) {
      e.input(k).array() += c.offset * random.normal();
      e.output(k).array() += c.offset * random.normal();
    }
    if (c.gaps) e.y(3, 10, 0) = e.y(50, 12, 1) = e.u(51, 3, 0) = std::numeric_limits<double>::quiet_NaN();
    const Ensemble first = e.subset(range(0, 40));
    const Identification begun = identify(first, c.options);
    UpdateState state = update_state(first, begun, c.options);
    EXPECT_LE(difference(identify(state).model, begun.model), 1e-10);
    update(state, e.subset(range(40, 45)));
    update(state, e.subset(range(45, 60)), {2, {}});
    IdentifyOptions all = c.options;
    all.lags = begun.plan.lags;
    all.initial_state = begun.model.initial_state;
    if (begun.plan.coupled) all.choices = begun.plan.choices;  // of the first experiments
    if (begun.plan.noisy && begun.plan.method != Method::regression) all.states = begun.model.states();
    const Updated now = identify(state);
    EXPECT_EQ(now.experiments, 60);
    const Model whole = identify(e, all).model;
    EXPECT_LE(difference(now.model, whole), 1e-10);
    EXPECT_EQ(now.model.initial_state, whole.initial_state);
    EXPECT_EQ(now.model.method, whole.method);
    EXPECT_EQ(now.model.u_nominal.size(), whole.u_nominal.size());
    if (whole.u_nominal.size() > 0) {
      EXPECT_LE((now.model.u_nominal - whole.u_nominal).norm(), 1e-12 * (1 + whole.u_nominal.norm()));
      EXPECT_LE((now.model.y_nominal - whole.y_nominal).norm(), 1e-12 * (1 + whole.y_nominal.norm()));
    }
    for (size_t s = 0; s < whole.step.size() && c.noise > 0; ++s)
      EXPECT_LE((now.model.step[s].innovation_cov() - whole.step[s].innovation_cov()).norm(),
                1e-9 * whole.step[s].innovation_cov().norm());
    EXPECT_TRUE(has_seen(now.model.provenance, e.subset(range(45, 60))));
  }
}

// Noise that comes later contradicts what was chosen without it.
TEST(Update, WarnsOfNoiseThatComesLater) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 16), 60, 17);
  UpdateState state = update_state(e.subset(range(0, 30)), identify(e.subset(range(0, 30))), {});
  EXPECT_TRUE(identify(state).findings.empty());
  update(state, with_noise(e.subset(range(30, 60)), 0.1, 18));
  const std::vector<std::string> warnings = in_words(identify(state).findings);
  ASSERT_FALSE(warnings.empty());
  EXPECT_NE(warnings.front().find("noisy"), std::string::npos);
}

// All of it but the units of TVERA, which the experiments of the state tell.
std::string kept(Plan plan) {
  plan.input_size.resize(0);
  plan.output_size.resize(0);
  return archive::packed(plan);
}

TEST(Update, StatesComeBackFromFiles) {
  const Ensemble exact = random_experiments(random_system({3, 2, 1}, 20, 1.0, 11), 30, 12);
  const Ensemble noisy = with_noise(exact, 0.05, 13);
  const Model constant = testing::constant_system({2, 1, 1}, 60, 0.9, 3);
  const Ensemble still = with_noise(random_experiments(constant, 12, 14), 0.05, 15);
  const std::vector<std::pair<const Ensemble*, IdentifyOptions>> cases = {
      {&exact, {}},
      {&exact, {.frame = Frame::reference, .reference_step = 7}},
      {&exact, {.nominal = NominalChoice::mean, .frame = Frame::smooth, .rows = 4, .cols = 5}},
      {&exact, {.method = Method::subspace, .initial_state = InitialState::unknown}},
      {&noisy, {.states = 3, .lags = 2}},
      {&noisy, {.method = Method::tvera}},
      {&noisy, {.smoothing = 10.0, .nominal = NominalChoice::mean}},
      {&still, {.period = 1, .weighting = Weighting::many_steps, .nominal = NominalChoice::mean}},
      {&still, {.period = 4, .weighting = Weighting::one_step}}};
  for (size_t i = 0; i < cases.size(); ++i) {
    const auto& [data, options] = cases[i];
    const UpdateState state = update_state(*data, identify(*data, options), options);
    for (const char* extension : {".h5", ".npz", ".mat"}) {
      const std::filesystem::path path =
          std::filesystem::path(::testing::TempDir()) / (std::string("tokid_update_state") + extension);
      save_update_state(state, path);
      const UpdateState back = load_update_state(path);
      EXPECT_EQ(back.factors.factor, state.factors.factor) << i << extension;
      EXPECT_EQ(back.factors.rows, state.factors.rows);
      EXPECT_EQ(back.factors.sum, state.factors.sum);
      EXPECT_EQ(io::provenance_text(back.provenance), io::provenance_text(state.provenance));
      EXPECT_EQ(back.digests, state.digests);
      EXPECT_EQ(back.without_digest, 0);
      EXPECT_EQ(kept(back.plan), kept(state.plan)) << i << extension;
      EXPECT_THROW(load_model(path), IoError);
      std::filesystem::remove(path);
    }
  }
}

// A state whose text somebody has changed.
TEST(Update, RefusesStatesWithoutTheirPlan) {
  const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 20, 0.9, 11), 30, 12), 0.05, 13);
  const UpdateState state = update_state(e, identify(e, {.refine = false}), {.refine = false});
  ASSERT_TRUE(state.plan.coupled);
  const std::filesystem::path path = std::filesystem::path(::testing::TempDir()) / "tokid_state_without_plan.npz";
  const auto refusal = [&](const std::string& from, const std::string& to) {
    UpdateState other = state;
    std::string text = io::provenance_text(state.provenance);
    const size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << text;
    other.provenance = io::provenance_of(text.replace(at, from.size(), to));
    save_update_state(other, path);
    try {
      load_update_state(path);
    } catch (const IoError& error) {
      return std::string(error.what());
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(refusal("\"refinement_iterations\":0", "\"refinement_iterations\":-1").find("no 'choices' found"),
            std::string::npos);
  EXPECT_NE(refusal("\"hold_out\"", "\"hold_on\"").find("\"hold_on\" is not known"), std::string::npos);
  std::filesystem::remove(path);
}

TEST(Update, RefusesWhatDoesNotFit) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 13), 30, 14);
  const Identification result = identify(e);
  UpdateState state = update_state(e, result, {});
  const auto refusal = [&](const Ensemble& more) { return message([&] { update(state, more); }); };
  EXPECT_EQ(refusal(random_experiments(random_system({3, 2, 1}, 21, 1.0, 13), 30, 14)),
            "steps: 21 found, 20 needed as in the earlier experiments");
  EXPECT_EQ(refusal(random_experiments(random_system({3, 1, 1}, 20, 1.0, 13), 30, 14)),
            "outputs: 1 found, 2 needed as in the earlier experiments");
  Ensemble other = random_experiments(random_system({3, 2, 1}, 20, 1.0, 13), 30, 15);
  other.dt = 0.5;
  EXPECT_EQ(refusal(other), "dt: 0.5 found, 1 needed as in the earlier experiments");
  other.dt = 1.0;
  other.names.output_names = {"a", "b"};
  EXPECT_EQ(refusal(other), "output: a found, y1 needed as in the earlier experiments");
  EXPECT_EQ(state.factors.experiments, 30);
  IdentifyOptions held;
  held.hold_out = 0.3;
  EXPECT_EQ(message([&] { update_state(e, identify(e, held), held); }),
            "hold-out fraction: held-out experiments found, but a state file needs all experiments; use no hold-out");
}

// Experiments in a random order, of a random system; some have gaps.
Ensemble random_campaign(Random& random, unsigned seed) {
  const Index m = Index(random.uniform(1, 4)), r = Index(random.uniform(1, 3)), steps = Index(random.uniform(12, 32));
  Ensemble e = with_noise(random_experiments(random_system({2, m, r}, steps, 1.0, seed), 60, seed + 1), 0.05, seed + 2);
  for (Index n = 0; n < 60; n += 7)
    e.y(n, Index(random.uniform(0, double(steps))), 0) = std::numeric_limits<double>::quiet_NaN();
  return e;
}

UpdateState state_of(const Ensemble& e) {
  IdentifyOptions options;
  options.lags = options.states = 2;
  options.refine = false;
  return update_state(e, identify(e, options), options);
}

void expect_same_state(const UpdateState& a, const UpdateState& b) {
  EXPECT_EQ(a.factors.factor, b.factors.factor);
  EXPECT_EQ(a.factors.experiments, b.factors.experiments);
  EXPECT_EQ(a.factors.rows, b.factors.rows);
  EXPECT_EQ(a.factors.sum, b.factors.sum);
  EXPECT_EQ(a.factors.spread, b.factors.spread);
  EXPECT_EQ(a.digests, b.digests);
}

TEST(Update, LeavesOutWhatTheStateHas) {
  Random random(40);
  for (unsigned seed = 100; seed < 112; ++seed) {
    SCOPED_TRACE(seed);
    const Ensemble e = random_campaign(random, seed);
    const Index first = Index(random.uniform(25, 40)), overlap = Index(random.uniform(1, double(first)));
    const Index end = Index(random.uniform(double(first + 1), 61));
    UpdateState once = state_of(e.subset(range(0, first))), twice = once;
    EXPECT_TRUE(update(once, e.subset(range(first, end))).empty());
    std::vector<Index> rows = range(first - overlap, end);
    std::shuffle(rows.begin(), rows.begin() + overlap, std::mt19937(seed));  // the new ones keep their order
    const std::vector<std::string> told = in_words(update(twice, e.subset(rows)));
    expect_same_state(twice, once);  // what is left out leaves no trace in a bit
    ASSERT_EQ(told.size(), 1);
    const std::string count = fmt::format("{} of {} experiments ", overlap, end - first + overlap);
    EXPECT_EQ(told.front().find(count), 0) << told.front();
    EXPECT_NE(told.front().find("in the state file already: \""), std::string::npos) << told.front();
    // Any part of what was given adds nothing.
    const UpdateState before = twice;
    EXPECT_EQ(in_words(update(twice, e.subset(range(0, end)))),
              std::vector{fmt::format("all {} experiments are in the state file already. Nothing is added", end)});
    EXPECT_EQ(in_words(update(twice, e.subset({first}))),
              std::vector<std::string>{"the experiment is in the state file already. Nothing is added"});
    expect_same_state(twice, before);
    EXPECT_TRUE(has_seen(identify(twice).model.provenance, e.subset(range(0, end))));
  }
}

TEST(Update, NamesWhatItLeavesOut) {
  Ensemble e = random_experiments(random_system({2, 1, 1}, 15, 1.0, 41), 40, 42);
  const UpdateState state = state_of(e.subset(range(0, 30)));
  Ensemble rows = e;
  rows.experiment_names.clear();
  const auto told = [&](const Ensemble& more) {
    UpdateState own = state;
    return in_words(update(own, more).front());
  };
  EXPECT_EQ(told(rows),
            "30 of 40 experiments are in the state file already: 0–29. These experiments are not added again");
  for (Index k = 0; k < 15; ++k) rows.output(k).row(3).array() += 1.0, rows.output(k).topRows(1).array() += 1.0;
  EXPECT_EQ(told(rows),
            "28 of 40 experiments are in the state file already: 1–2 and 4–29. These experiments are not added again");
  for (Index n = 0; n < 40; ++n) e.experiment_names.push_back(fmt::format("run {}", n));
  EXPECT_EQ(told(e.subset({35, 7, 36})),
            "1 of 3 experiments is in the state file already: \"run 7\" (row 1). This experiment is not added again");
  EXPECT_EQ(
      told(e),
      "30 of 40 experiments are in the state file already: \"run 0\" (row 0), \"run 1\" (row 1), \"run 2\" (row 2), "
      "\"run 3\" (row 3), \"run 4\" (row 4), \"run 5\" (row 5) and 24 more. These experiments are not added again");
}

// Files that overlap: the same digests in whatever order, and the same products within the rounding of the merges.
TEST(Update, KnowsTheUnionOfWhatOverlaps) {
  Random random(43);
  for (unsigned seed = 200; seed < 206; ++seed) {
    const Ensemble e = random_campaign(random, seed);
    const UpdateState state = state_of(e.subset(range(0, 30)));
    std::vector<Ensemble> files{e.subset(range(20, 40)), e.subset(range(35, 55)), e.subset(range(10, 60))};
    UpdateState whole = state, in_order = state, backwards = state;
    update(whole, e.subset(range(30, 60)));
    for (const Ensemble& file : files) update(in_order, file);
    std::reverse(files.begin(), files.end());
    for (const Ensemble& file : files) update(backwards, file);
    for (const UpdateState& own : {in_order, backwards}) {
      EXPECT_EQ(own.digests, whole.digests);
      EXPECT_EQ(own.factors.experiments, 60);
      EXPECT_EQ(own.factors.rows, whole.factors.rows);
      for (Index k = own.factors.begin(); k < e.steps(); ++k) {
        const Matrix a = own.factors.of(k).transpose() * own.factors.of(k);
        const Matrix b = whole.factors.of(k).transpose() * whole.factors.of(k);
        EXPECT_LE((a - b).norm(), 1e2 * epsilon * b.norm()) << k;  // one factorisation after another, three at most
      }
    }
  }
}

// A copy within rounding is left out with the experiment that the state has, and is known by itself from then on.
TEST(Update, KnowsCopiesOfWhatItHas) {
  const Ensemble e = with_noise(random_experiments(random_system({2, 2, 1}, 30, 1.0, 44), 50, 45), 0.05, 46);
  std::vector<Index> order = range(25, 50);
  order.push_back(27);  // row 25: a copy of what the state has
  order.push_back(40);  // row 26: a copy of what is new
  Ensemble more = e.subset(order);
  for (const Index n : {25, 26})
    for (Index k = 0; k < 30; ++k)
      for (Index c = 0; c < e.channels(); ++c)
        more.samples()(n, k * e.channels() + c) = double(float(more.samples()(n, k * e.channels() + c)));
  UpdateState once = state_of(e.subset(range(0, 30))), state = once;
  update(once, e.subset(range(30, 50)));
  EXPECT_EQ(
      in_words(update(state, more)),
      (std::vector<std::string>{
          "6 of 27 experiments are in the state file already: 0–4 and 25. These experiments are not added again",
          "1 of 27 experiments is a copy of another experiment, within rounding: experiment 26 of experiment 15. The "
          "copy is not used"}));
  EXPECT_EQ(state.factors.factor, once.factors.factor);
  EXPECT_EQ(state.factors.experiments, 50);
  EXPECT_EQ(state.digests.size(), 52);
  update(state, more.subset({25, 26}));
  EXPECT_EQ(state.factors.experiments, 50);
}

TEST(Update, SaysWhatAStateWithoutDigestsCannotTell) {
  const Ensemble e = random_experiments(random_system({2, 1, 1}, 15, 1.0, 47), 50, 48);
  const Ensemble first = e.subset(range(0, 30)), more = e.subset(range(30, 40));
  UpdateState state = state_of(first);
  state.digests.clear();
  state.without_digest = 30;
  const std::filesystem::path path = std::filesystem::path(::testing::TempDir()) / "tokid_update_old.npz";
  save_update_state(state, path);  // as an earlier version did
  state = load_update_state(path);
  EXPECT_EQ(state.without_digest, 30);
  // By its fingerprint a whole ensemble is known all the same.
  EXPECT_EQ(in_words(update(state, first)),
            std::vector<std::string>{"all 30 experiments are in the state file already. Nothing is added"});
  EXPECT_EQ(state.factors.experiments, 30);
  const auto warned = [&](const Ensemble& added) {
    const std::vector<std::string> told = in_words(update(state, added));
    return !told.empty() && told.back().find("no digests of 30 experiments") != std::string::npos;
  };
  EXPECT_TRUE(warned(more));
  save_update_state(state, path);
  state = load_update_state(path);
  std::filesystem::remove(path);
  EXPECT_EQ(state.without_digest, 30);
  EXPECT_EQ(state.factors.experiments, 40);
  EXPECT_TRUE(warned(e.subset(range(35, 50))));
  EXPECT_EQ(state.factors.experiments, 50);
}

// Parts of an ensemble in files that are removed with it; not .h5, which threads can't read side by side.
class Files {
 public:
  void add(const Ensemble& part) {
    const std::string test = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    paths.push_back(std::filesystem::path(::testing::TempDir()) /
                    ("tokid_" + test + "_" + std::to_string(paths.size()) + ".npz"));
    save_ensemble(part, paths.back());
  }
  ~Files() {
    for (const std::filesystem::path& path : paths) std::filesystem::remove(path);
  }
  std::vector<std::filesystem::path> paths;
};

TEST(UpdateFromFiles, IsTheSameForAnyNumberOfMembers) {
  const Ensemble e = with_noise(random_experiments(random_system({3, 2, 1}, 20, 1.0, 21), 70, 22), 0.05, 23);
  IdentifyOptions options;
  options.lags = 2;
  options.states = 3;
  options.refine = false;
  const UpdateState begun = update_state(e.subset(range(0, 40)), identify(e.subset(range(0, 40)), options), options);
  const Model before = identify(begun).model;
  UpdateState one_by_one = begun;
  Files files;
  std::vector<std::vector<Index>> known;
  for (Index from = 40; from < 70; from += 6) {
    const Index overlap = (from - 40) / 6;  // with the file before it
    const Ensemble part = e.subset(range(from - overlap, from + 6));
    known.push_back(range(0, overlap));
    files.add(part);
    update(one_by_one, part);
  }
  for (const Index members : {1, 2, 3, 4, 7}) {
    UpdateState state = begun;
    Additions added;
    Threads(members).run([&](const Team& team) {
      UpdateState none;
      const bool first = team.rank == 0;
      Additions own = update(first ? state : none, first ? before : Model(), files.paths, {{}, {2, {}}, team});
      if (first) added = std::move(own);
    });
    EXPECT_EQ(state.factors.factor, one_by_one.factors.factor) << members;
    EXPECT_EQ(state.factors.sum, one_by_one.factors.sum);
    EXPECT_EQ(state.factors.spread, one_by_one.factors.spread);
    EXPECT_EQ(state.factors.count, one_by_one.factors.count);
    EXPECT_EQ(state.factors.rows, one_by_one.factors.rows);
    EXPECT_EQ(io::provenance_text(state.provenance), io::provenance_text(one_by_one.provenance));
    EXPECT_EQ(state.digests, one_by_one.digests);
    EXPECT_EQ(added.experiments, std::vector<Index>(5, 6));
    EXPECT_EQ(added.known, known);
  }
}

// Sums over the files, not means of their fits.
TEST(UpdateFromFiles, FitsAreThoseOfAllNewExperiments) {
  std::vector<UpdateCase> cases(5);
  cases[0].name = "noise";
  cases[1].name = "unknown initial states, gaps";
  cases[1].initial = 2.0;
  cases[1].gaps = true;
  cases[1].options.initial_state = InitialState::unknown;
  cases[2].name = "mean motion";
  cases[2].offset = 2.0;
  cases[2].options.nominal = NominalChoice::mean;
  cases[3].name = "one model";
  cases[3].options.period = 1;
  cases[4].name = "unknown initial states";
  cases[4].initial = 2.0;
  cases[4].options.initial_state = InitialState::unknown;
  for (UpdateCase& c : cases) {
    SCOPED_TRACE(c.name);
    c.options.lags = 3;
    c.options.states = 3;
    c.options.refine = false;
    Ensemble e = with_noise(random_experiments(random_system({3, 2, 2}, 24, 1.0, 24), 60, 25, c.initial), 0.1, 26);
    Random random(27);
    for (Index k = 0; c.offset > 0 && k < 24; ++k) e.output(k).array() += c.offset * random.normal();
    // So that files differ in their means.
    for (Index k = 0; k < 24; ++k) e.output(k).bottomRows(5).array() += 1.0;
    if (c.gaps) e.y(43, 10, 0) = e.y(50, 12, 1) = std::numeric_limits<double>::quiet_NaN();
    const Ensemble first = e.subset(range(0, 40));
    UpdateState state = update_state(first, identify(first, c.options), c.options);
    const Model before = identify(state).model;
    Files files;
    files.add(e.subset(range(40, 47)));
    files.add(e.subset(range(47, 60)));
    const Additions added = update(state, before, files.paths);
    ValidateOptions options;
    options.initial_state = before.initial_state;
    const Validation all = validate(before, e.subset(range(40, 60)), options);
    EXPECT_LE((added.simulation.fit - all.simulation.fit).norm(), 1e-8);
    EXPECT_LE((added.one_step.fit - all.one_step.fit).norm(), 1e-8);
    EXPECT_LE((added.one_step.rmse - all.one_step.rmse).norm(), 1e-10 * all.one_step.rmse.norm());
    EXPECT_EQ(added.one_step.samples, all.one_step.samples);
    EXPECT_EQ(added.simulation.samples, all.simulation.samples);
    EXPECT_TRUE(all.simulation.fit.allFinite() && all.one_step.fit.allFinite());
  }
}

TEST(UpdateFromFiles, NamesTheFileThatDoesNotFit) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 28), 50, 29);
  const UpdateState begun = update_state(e.subset(range(0, 40)), identify(e.subset(range(0, 40))), {});
  const Model before = identify(begun).model;
  Files files;
  files.add(e.subset(range(40, 45)));
  files.add(random_experiments(random_system({3, 2, 1}, 21, 1.0, 28), 5, 30));
  const std::string one = files.paths[0].string(), longer = files.paths[1].string();
  const auto refusal = [&](const std::vector<std::filesystem::path>& paths) {
    UpdateState state = begun;
    return message([&] { update(state, before, paths); });
  };
  EXPECT_EQ(refusal({one, longer}), longer + ": steps: 21 found, 20 needed as in the earlier experiments");
  UpdateState state = begun;
  EXPECT_THROW(update(state, before, {one, "none.h5"}), IoError);
}

TEST(UpdateFromFiles, AFileThatAddsNothingIsTold) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 31), 50, 32);
  const UpdateState first = state_of(e.subset(range(0, 40)));
  const Model before = identify(first).model;
  Files files;
  files.add(e.subset(range(40, 45)));
  files.add(e.subset(range(0, 40)));
  const std::string one = files.paths[0].string(), seen = files.paths[1].string();
  UpdateState state = first;
  const Additions added = update(state, before, {one, seen, one});
  EXPECT_EQ(added.experiments, (std::vector<Index>{5, 0, 0}));
  EXPECT_EQ(added.known, (std::vector<std::vector<Index>>{{}, range(0, 40), range(0, 5)}));
  EXPECT_EQ(in_words(added.findings),
            (std::vector<std::string>{seen + ": all 40 experiments are in the state file already. Nothing is added",
                                      one + ": all 5 experiments are in the state file already. Nothing is added"}));
  UpdateState alone = first;
  const Additions of_one = update(alone, before, e.subset(range(40, 45)));
  expect_same_state(state, alone);
  EXPECT_EQ(added.simulation.fit, of_one.simulation.fit);
  EXPECT_EQ(added.one_step.samples, of_one.one_step.samples);
  // Nothing at all: no figures, and no complaint about outputs that never move.
  state = first;
  const Additions none = update(state, before, {seen});
  expect_same_state(state, first);
  EXPECT_EQ(io::provenance_text(state.provenance), io::provenance_text(first.provenance));
  EXPECT_EQ(none.findings.size(), 1);
  EXPECT_TRUE(none.one_step.fit.size() == 2 && none.one_step.fit.array().isNaN().all());
}

std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const IoError& error) {
    return error.what();
  }
  return "no exception";
}

class FileLocks : public ::testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directory(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path file(const char* name) const { return folder_ / name; }
  Index files() const {
    return Index(std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator()));
  }

 private:
  std::filesystem::path folder_ = std::filesystem::temp_directory_path() / fmt::format("tokid-locks-{}", getpid());
};

TEST_F(FileLocks, OneHolderAtATime) {
  {
    const FileLock held(file("state.h5"));
    EXPECT_EQ(files(), 1);
    EXPECT_NE(refusal([&] { FileLock(file("state.h5"), {.limit = 0.0}); }).find("this process has locked the file;"),
              std::string::npos);
    const FileLock other(file("other.h5"), {.limit = 0.0});
    std::string said;
    EXPECT_THROW(FileLock(file("state.h5"), {.limit = 0.02, .waits = [&](const std::string& text) { said = text; }}),
                 IoError);
    EXPECT_NE(said.find("this process has locked the file; waiting for up to 0.02 s"), std::string::npos) << said;
  }
  EXPECT_EQ(files(), 0);
  const FileLock again(file("state.h5"), {.limit = 0.0});
}

TEST_F(FileLocks, ThreadsFollowEachOther) {
  constexpr int threads = 4, rounds = 40;
  int count = 0;  // guarded by the lock alone
  {
    std::vector<std::jthread> all;
    for (int i = 0; i < threads; ++i)
      all.emplace_back([&] {
        for (int round = 0; round < rounds; ++round) {
          const FileLock held(file("count"));
          const int before = count;
          std::this_thread::yield();
          count = before + 1;
        }
      });
  }
  EXPECT_EQ(count, threads * rounds);
  EXPECT_EQ(files(), 0);
}

// An empty file without a lock is what a process that was killed leaves.
TEST_F(FileLocks, WhatADeadProcessLeavesIsTakenOver) {
  const pid_t child = fork();
  if (child == 0) {
    const FileLock held(file("state.h5"));
    raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(files(), 1);
  { const FileLock held(file("state.h5"), {.limit = 0.0}); }
  EXPECT_EQ(files(), 0);
}

TEST_F(FileLocks, TellOfWhoeverAsksForNone) {
  Ensemble e = random_experiments(random_system({2, 1, 1}, 12, 1.0, 1), 20, 2, 1.0);
  const UpdateState state = update_state(e, identify(e, {}), {});
  save_update_state(state, file("state.h5"));
  FileLock held(file("state.h5"));
  save_update_state(state, held);
  save_update_state(state, held);  // it has seen what it saved
  save_update_state(state, file("state.h5"));
  const std::string said = refusal([&] { save_update_state(state, held); });
  EXPECT_NE(said.find("another program has changed the file"), std::string::npos) << said;
  held.see();
  EXPECT_NO_THROW(held.check());
  std::filesystem::remove(file("state.h5"));
  EXPECT_THROW(held.check(), IoError);
}

TEST_F(FileLocks, RefuseALimitThatIsNone) {
  for (const double limit : {-1.0, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(FileLock(file("x"), {.limit = limit}), std::invalid_argument);
  EXPECT_THROW(FileLock(file("none") / "x"), IoError);
}

}  // namespace
}  // namespace tokid
