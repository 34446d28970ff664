// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <functional>
#include <iterator>
#include <limits>
#include <thread>

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
using testing::Threads;
using testing::with_noise;

std::vector<Index> range(Index begin, Index end) {
  std::vector<Index> list;
  for (Index n = begin; n < end; ++n) list.push_back(n);
  return list;
}

// Of windows from an ensemble: the same products as the samples have.
TEST(WindowFactors, HaveTheProductsOfTheWindows) {
  for (const bool gaps : {false, true})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const Index lags : {1, 3, 7}) {
        Ensemble e = with_noise(random_experiments(random_system({3, 2, 1}, 20, 1.0, 1), 30, 2, 1.0), 0.1, 3);
        if (gaps) e.y(4, 9, 1) = e.u(6, 15, 0) = std::numeric_limits<double>::quiet_NaN();
        const WindowFactors f = window_factors(e, lags, initial);
        const Windows samples(e), factors(f);
        EXPECT_EQ(f.begin(), initial == InitialState::zero ? 0 : lags);
        for (Index k = f.begin(); k < 20; ++k) {
          const Matrix a = samples.rows(k, lags), r = factors.rows(k, lags);
          EXPECT_EQ(samples.count(k, lags), a.rows());
          EXPECT_EQ(f.rows[size_t(k)], a.rows());
          EXPECT_LE((r.transpose() * r - a.transpose() * a).norm(), 1e2 * epsilon * a.squaredNorm()) << k;
          EXPECT_TRUE(Matrix(f.of(k)).isUpperTriangular(0.0));
        }
        // Of departures from the mean motion, too.
        const Nominal mean = nominal_trajectory(e), own = f.nominal();
        EXPECT_LE((mean.u - own.u).norm() + (mean.y - own.y).norm(), 1e2 * epsilon * (mean.y.norm() + mean.u.norm()));
        const Ensemble left = departures(e, mean);
        const Windows centred(f, &own), departed(left);
        for (Index k = f.begin(); k < 20; ++k) {
          const Matrix a = departed.rows(k, lags), r = centred.rows(k, lags);
          EXPECT_LE((r.transpose() * r - a.transpose() * a).norm(),
                    1e3 * epsilon * samples.rows(k, lags).squaredNorm());
        }
      }
}

TEST(WindowFactors, MergeToThoseOfAllExperiments) {
  const Ensemble e = with_noise(random_experiments(random_system({3, 2, 2}, 15, 1.0, 4), 40, 5), 0.1, 6);
  WindowFactors all = window_factors(e.subset(range(0, 7)), 2, InitialState::zero);
  merge(all, window_factors(e.subset(range(7, 8)), 2, InitialState::zero));
  merge(all, window_factors(e.subset(range(8, 40)), 2, InitialState::zero), {3, {}});
  EXPECT_EQ(all.experiments, 40);
  const WindowFactors once = window_factors(e, 2, InitialState::zero);
  EXPECT_EQ(all.rows, once.rows);
  for (Index k = 0; k < 15; ++k) {
    const Matrix a = all.of(k).transpose() * all.of(k), b = once.of(k).transpose() * once.of(k);
    EXPECT_LE((a - b).norm(), 1e2 * epsilon * b.norm());
  }
}

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
  std::vector<UpdateCase> cases(10);
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
    all.lags = begun.lags;
    all.initial_state = begun.model.initial_state;
    all.choices = begun.choices;  // of the first experiments
    if (begun.noisy) all.states = begun.model.states();
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
    EXPECT_TRUE(has_seen(now.model, e.subset(range(45, 60))));
  }
}

// Noise that comes later contradicts what was chosen without it.
TEST(Update, WarnsOfNoiseThatComesLater) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 16), 60, 17);
  UpdateState state = update_state(e.subset(range(0, 30)), identify(e.subset(range(0, 30))), {});
  EXPECT_TRUE(identify(state).warnings.empty());
  update(state, with_noise(e.subset(range(30, 60)), 0.1, 18));
  const std::vector<std::string> warnings = identify(state).warnings;
  ASSERT_FALSE(warnings.empty());
  EXPECT_NE(warnings.front().find("noisy"), std::string::npos);
}

TEST(Update, StatesComeBackFromFiles) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 11), 30, 12);
  const UpdateState state = update_state(e, identify(e), {});
  for (const char* extension : {".h5", ".npz", ".mat"}) {
    const std::filesystem::path path =
        std::filesystem::path(::testing::TempDir()) / (std::string("tokid_update_state") + extension);
    save_update_state(state, path);
    const UpdateState back = load_update_state(path);
    EXPECT_EQ(back.factors.factor, state.factors.factor) << extension;
    EXPECT_EQ(back.factors.rows, state.factors.rows);
    EXPECT_EQ(back.factors.sum, state.factors.sum);
    EXPECT_EQ(back.options, state.options);
    EXPECT_EQ(std::tuple(back.method, back.states, back.together, back.noisy, back.nominal),
              std::tuple(state.method, state.states, state.together, state.noisy, state.nominal));
    EXPECT_THROW(load_model(path), IoError);
    std::filesystem::remove(path);
  }
}

TEST(Update, RefusesWhatDoesNotFit) {
  const Ensemble e = random_experiments(random_system({3, 2, 1}, 20, 1.0, 13), 30, 14);
  const Identification result = identify(e);
  UpdateState state = update_state(e, result, {});
  const auto refusal = [&](const Ensemble& more) { return message([&] { update(state, more); }); };
  EXPECT_EQ(refusal(e), "experiments: the state has these already, they would count twice");
  EXPECT_EQ(refusal(random_experiments(random_system({3, 2, 1}, 21, 1.0, 13), 30, 14)),
            "steps: 21 found, 20 needed as in the experiments before");
  EXPECT_EQ(refusal(random_experiments(random_system({3, 1, 1}, 20, 1.0, 13), 30, 14)),
            "outputs: 1 found, 2 needed as in the experiments before");
  Ensemble other = random_experiments(random_system({3, 2, 1}, 20, 1.0, 13), 30, 15);
  other.dt = 0.5;
  EXPECT_EQ(refusal(other), "dt: 0.5 found, 1 needed as in the experiments before");
  other.dt = 1.0;
  other.names.output_names = {"a", "b"};
  EXPECT_EQ(refusal(other), "output: a found, y1 needed as in the experiments before");
  EXPECT_EQ(state.factors.experiments, 30);
  IdentifyOptions held;
  held.hold_out = 0.3;
  EXPECT_EQ(message([&] { update_state(e, identify(e, held), held); }),
            "hold-out fraction: a state is of all experiments, none can be held out");
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
  for (Index from = 40; from < 70; from += 6) {
    const Ensemble part = e.subset(range(from, from + 6));
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
    EXPECT_EQ(state.options, one_by_one.options);
    EXPECT_EQ(added.experiments, std::vector<Index>(5, 6));
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
  files.add(e.subset(range(0, 40)));
  files.add(random_experiments(random_system({3, 2, 1}, 21, 1.0, 28), 5, 30));
  const std::string one = files.paths[0].string(), seen = files.paths[1].string(), longer = files.paths[2].string();
  const auto refusal = [&](const std::vector<std::filesystem::path>& paths) {
    UpdateState state = begun;
    return message([&] { update(state, before, paths); });
  };
  EXPECT_EQ(refusal({one, seen}), seen + ": experiments: the state has these already, they would count twice");
  EXPECT_EQ(refusal({one, longer}), longer + ": steps: 21 found, 20 needed as in the experiments before");
  EXPECT_EQ(refusal({one, one}), one + ": experiments: the same as in " + one + ", they would count twice");
  UpdateState state = begun;
  EXPECT_THROW(update(state, before, {one, "none.h5"}), IoError);
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
    EXPECT_NE(refusal([&] { FileLock(file("state.h5"), {.limit = 0.0}); }).find("this process has it locked;"),
              std::string::npos);
    const FileLock other(file("other.h5"), {.limit = 0.0});
    std::string said;
    EXPECT_THROW(FileLock(file("state.h5"), {.limit = 0.02, .waits = [&](const std::string& text) { said = text; }}),
                 IoError);
    EXPECT_NE(said.find("this process has it locked; waiting for up to 0.02 s"), std::string::npos) << said;
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
  EXPECT_NE(said.find("another program has replaced it meanwhile"), std::string::npos) << said;
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
