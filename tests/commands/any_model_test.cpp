// Every command that takes a model, with random models of all shapes: the command works, or refuses the model. It never
// crashes. TOKID_MODELS=1000 build/bin/tokid_command_tests tries so many models; TOKID_FIRST_MODEL is the first one.
// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <random>

#include "io/formats/files.hpp"
#include "io/formats/schema.hpp"
#include "model/continuation.hpp"
#include "testing.hpp"
#include "tokid/tokid.hpp"
#include "tool.hpp"

namespace tokid {
namespace {

namespace fs = std::filesystem;
using testing::Random;

// ---- random models ----

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}
  Index below(Index n) { return Index(engine_() % std::uint64_t(n)); }
  bool one_in(Index n) { return below(n) == 0; }
  template <class Value>
  Value of(std::initializer_list<Value> values) {
    return *(values.begin() + below(Index(values.size())));
  }

 private:
  std::mt19937_64 engine_;
};

// n_k, with one entry more than steps. The dimension repeats over the last period if the model goes on.
std::vector<Index> dimensions(Dice& dice, Index steps, Index period) {
  const Index n = dice.of<Index>({0, 1, 2, 2, 3, 4}), shape = dice.below(5);
  std::vector<Index> result(size_t(steps) + 1, n);
  const Index changes = dice.below(steps + 1);
  for (Index s = 0; s <= steps; ++s) {
    Index& here = result[size_t(s)];
    if (shape == 1 && s < changes) here = n + 1 + dice.below(3);  // more states at first
    if (shape == 2 && s < changes) here = std::min(n, s);         // fewer states at first
    if (shape == 3 && s > changes) here = dice.below(n + 1);      // fewer states later
    if (shape == 4) here = dice.below(5);
  }
  if (period > 0 && period <= steps) result.back() = result[size_t(steps - period)];
  return result;
}

Matrix covariance(Random& random, Index n) {
  const Matrix root = random.matrix(n, n);
  return 0.1 * root * root.transpose() + 0.01 * Matrix::Identity(n, n);
}

Model random_model(Dice& dice, Random& random) {
  Model model;
  const Index steps = dice.of<Index>({1, 2, 3, 5, 8, 12, 20}), r = dice.of<Index>({0, 1, 1, 2}),
              m = dice.of<Index>({1, 1, 2, 3});
  model.inputs = r;
  model.outputs = m;
  model.k_begin = dice.of<Index>({0, 0, 0, 0, 1, 1, 4, 4, 1000});
  model.dt = 0.1;
  model.method = dice.of<const char*>({"known", "tvera", "subspace", "em"});
  model.period = dice.of<Index>({0, 0, 0, 1, 2, 3, steps, steps + 1, 1'000'000'000'000});
  model.initial_state = dice.one_in(2) ? InitialState::zero : InitialState::unknown;
  const std::vector<Index> n = dimensions(dice, steps, model.period);
  const bool with_gain = dice.one_in(2), with_covariance = dice.one_in(2), with_noise = dice.one_in(2),
             with_kalman = dice.one_in(3), diagnosed = dice.one_in(3);
  for (Index s = 0; s < steps; ++s) {
    const Index before = n[size_t(s)], after = n[size_t(s) + 1];
    Step& step = model.step.emplace_back(before, after, r, m);
    step.A() = 0.5 * random.matrix(after, before);
    step.B() = random.matrix(after, r);
    step.C() = random.matrix(m, before);
    step.D() = random.matrix(m, r);
    if (with_gain) step.G() = 0.1 * random.matrix(after, m);
    if (with_covariance) step.set_innovation_cov(covariance(random, m));
    if (with_noise) step.set_Q(covariance(random, after));
    if (with_noise) step.set_R(covariance(random, m));
    if (with_kalman) step.set_K(0.1 * random.matrix(before, m));
    if (!diagnosed) continue;
    step.set_singular_values(Vector::Ones(dice.below(5)));
    step.set_condition(2.0);
    step.set_rank(1);
    step.set_lags(dice.below(4));
  }
  if (dice.one_in(2)) model.x0_mean = random.matrix(n.front(), 1);
  if (dice.one_in(2)) model.x0_cov = covariance(random, n.front());
  if (dice.one_in(3)) {
    const Index end = std::min<Index>(model.k_end(), 40), rows = dice.of<Index>({1, 2, 3, end, end + 5, 40});
    model.u_nominal = random.matrix(rows, r);
    model.y_nominal = random.matrix(rows, m);
  }
  if (dice.one_in(4)) {
    model.provenance.options.emplace();
    model.provenance.options->method = model.method == "tvera" ? Method::tvera : Method::subspace;
    model.provenance.options->lags = 1;
    model.provenance.options->states = std::max<Index>(1, model.states());
    model.provenance.options->period = goes_on(model) ? model.period : 0;
  }
  return model;
}

// Breaks one rule of Model::check(). A file can hold the result.
void damage(Model& model, Dice& dice, Random& random) {
  const Index n = model.n(model.k_begin), m = model.outputs, r = model.inputs;
  Step& end = model.step.back();
  switch (dice.below(8)) {
    case 0:
      model.x0_mean = random.matrix(n + 1, 1);
      break;
    case 1:
      model.x0_cov = Matrix::Identity(n + 1, n + 1);
      break;
    case 2:
      model.u_nominal = random.matrix(3, r + 1);
      model.y_nominal = random.matrix(3, m);
      break;
    case 3:
      model.u_nominal = random.matrix(3, r);
      model.y_nominal = random.matrix(4, m);
      break;
    case 4:
      end.C().setConstant(testing::nan);
      model.dt = end.states() > 0 ? model.dt : -1.0;
      break;
    case 5:
      for (Step& step : model.step) step.set_lags(Index{1} << 50);
      break;
    case 6:
      model.k_begin = -1;
      break;
    default:  // other states at the end of a period than at its begin
      model.period = 1 + dice.below(model.steps());
      const Index begin = model.n(model.k_end() - model.period);
      Step next(end.states(), begin > 0 && dice.one_in(2) ? begin - 1 : begin + 1, r, m);
      next.C() = end.C();
      next.take_diagnostics_of(end);
      if (end.has_Q()) next.set_Q(Matrix::Identity(next.next_states(), next.next_states()));
      if (end.has_R()) next.set_R(end.R());
      if (end.has_K()) next.set_K(end.K());
      end = next;
  }
}

Ensemble random_data(const Model& model, Dice& dice, Random& random) {
  const Index end = std::min<Index>(model.k_end(), 40);
  const Index steps = dice.of<Index>({1, 2, end, end + 1, end + 7, 30}), experiments = dice.of<Index>({1, 2, 6, 12}),
              kind = dice.below(4);
  Ensemble data(experiments, steps, model.inputs, model.outputs, model.dt);
  for (Index k = 0; k < steps; ++k) {
    data.output(k) = random.matrix(experiments, model.outputs);
    if (kind == 0) data.input(k).setConstant(1.0);  // inputs that do not vary
    if (kind > 1) data.input(k) = random.matrix(experiments, model.inputs);
    if (kind == 2 && dice.one_in(4)) data.y(dice.below(experiments), k, 0) = testing::nan;
    if (kind == 2 && dice.one_in(8) && model.inputs > 0) data.u(dice.below(experiments), k, 0) = testing::nan;
  }
  if (dice.one_in(2)) data.initial_state = dice.one_in(2) ? InitialState::zero : InitialState::unknown;
  return data;
}

// ---- the tool in this process ----

// What the tool prints goes nowhere.
class Quiet {
 public:
  Quiet() : kept_(dup(STDOUT_FILENO)), kept_error_(dup(STDERR_FILENO)) {
    const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    dup2(nowhere, STDOUT_FILENO);
    dup2(nowhere, STDERR_FILENO);
    close(nowhere);
  }
  ~Quiet() {
    std::fflush(stdout);
    dup2(kept_, STDOUT_FILENO);
    dup2(kept_error_, STDERR_FILENO);
    close(kept_);
    close(kept_error_);
  }
  Quiet(const Quiet&) = delete;
  Quiet& operator=(const Quiet&) = delete;

 private:
  int kept_, kept_error_;
};

app::Outcome run(const std::string& line) {
  std::vector<std::string> words{"tokid"};
  for (size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
    end = line.find(' ', begin);
    words.push_back(line.substr(begin, end - begin));
  }
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  const Quiet quiet;
  return app::run_tool(int(arguments.size()), arguments.data());
}

// MODEL, DATA, ONE (an ensemble of one experiment), OTHER (another model) and OUT (a path without extension) are
// replaced.
constexpr const char* command_lines[] = {
    "info MODEL",
    "info MODEL --json",
    "convert MODEL OUT.npz",
    "convert MODEL OUT.h5",
    "validate MODEL DATA",
    "validate MODEL DATA --horizon 2 --from 1 --json",
    "predict MODEL DATA -o OUT.npz",
    "predict MODEL DATA -o OUT.npz --horizon 3",
    "simulate MODEL DATA -o OUT.npz",
    "simulate MODEL DATA -o OUT.npz --estimate-state",
    "report MODEL DATA -o OUT.html",
    "report MODEL DATA -o OUT.html --at 0,5 --compare OTHER",
    "report MODEL DATA -o OUT.html --bands DATA --at 2",
    "lqr MODEL -o OUT.npz",
    "lqr MODEL -o OUT.npz --end 9 --simulate OUT.h5 --input-rate-weight 1 --experiments 3",
    "lqr MODEL -o OUT.npz --begin 3 --simulate OUT.h5 --truth OTHER --experiments 3",
    "lqr MODEL -o OUT.npz --reference ONE",
    "learn MODEL ONE ONE -o OUT.npz",
    "learn MODEL DATA ONE -o OUT.npz --input-rate-weight 1",
    "modes MODEL",
    "modes MODEL --at 0 --json -o OUT.csv",
    "modes MODEL --window 4 --at 5",
    "modes MODEL --confidence DATA --replicates 2",
    "confidence MODEL DATA -o OUT.npz --replicates 2",
    "export MODEL -o OUT.c",
    "export MODEL -o OUT.c --start-from-zero --float",
    "refine MODEL DATA -o OUT.npz --iterations 2 --smoothing 1",
    "refine MODEL DATA -o OUT.npz --iterations 2 --smoothing 0 --initial-state unknown",
    "refine MODEL DATA -o OUT.npz --iterations 2 --period 2",
    "plan --model MODEL -o OUT.npz",
    "plan --model MODEL -o OUT.npz --kind binary --experiments 4 --steps 12",
};

std::string replaced(std::string line, const std::map<std::string, std::string>& by) {
  for (const auto& [name, text] : by)
    for (size_t at = line.find(name); at != std::string::npos; at = line.find(name, at + text.size()))
      line.replace(at, name.size(), text);
  return line;
}

// What the library says of computations that fail.
bool documented(const std::string& complaint) {
  for (const char* known : {"no finite likelihood", "EM has diverged", "the model is not finite"})
    if (complaint.find(known) != std::string::npos) return true;
  return false;
}

Index number_from(const char* variable, Index usual) {
  const char* text = std::getenv(variable);
  return text ? std::stoll(text) : usual;
}

class AnyModel : public ::testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / ("tokid-any-model-" + std::to_string(getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  std::string path(const char* name) const { return (directory_ / name).string(); }

  // Calls `use` with the number of each model, its random numbers, and the model.
  static void for_each(Index usual, const std::function<void(std::uint64_t, Dice&, Random&, const Model&)>& use) {
    const Index first = number_from("TOKID_FIRST_MODEL", 1), count = number_from("TOKID_MODELS", usual);
    for (Index i = first; i < first + count; ++i) {
      Dice dice{std::uint64_t(i)};
      Random random{std::uint64_t(i)};
      const Model model = random_model(dice, random);
      use(std::uint64_t(i), dice, random, model);
      if (HasFailure()) return;
    }
  }

  fs::path directory_;
};

TEST_F(AnyModel, WorksOrIsRefusedInEveryCommand) {
  std::map<std::string, Index> outcomes;
  for_each(20, [&](std::uint64_t i, Dice& dice, Random& random, const Model& model) {
    SCOPED_TRACE(fmt::format("model {}", i));
    ASSERT_NO_THROW(model.check());
    const std::string file = path(dice.of({"model.npz", "model.npz", "model.h5", "model.mat"}));
    save_model(model, file);
    Ensemble data = random_data(model, dice, random);
    save_ensemble(data, path("data.npz"));
    save_ensemble(data.subset({data.experiments() - 1}), path("one.npz"));
    Dice others(i + 1'000'000);
    save_model(dice.one_in(2) ? model : random_model(others, random), path("other.npz"));
    for (const char* line : command_lines) {
      const std::string words = replaced(line, {{"MODEL", file},
                                                {"DATA", path("data.npz")},
                                                {"ONE", path("one.npz")},
                                                {"OTHER", path("other.npz")},
                                                {"OUT", path("out")}});
      SCOPED_TRACE(line);
      if (std::getenv("TOKID_MODELS")) fmt::print(stderr, "\r{} {}\033[K", i, line);
      const app::Outcome outcome = run(words);
      if (outcome.status == 1)
        EXPECT_TRUE(documented(outcome.complaint)) << outcome.complaint;
      else
        EXPECT_TRUE(outcome.status == 0 || outcome.status == 2) << outcome.status;
      ++outcomes[fmt::format("{}: {}", std::string(line).substr(0, std::string(line).find(' ')), outcome.status)];
    }
  });
  for (const auto& [name, count] : outcomes) RecordProperty(name, int(count));
  // A command that refused each model would not have been tested.
  for (const char* command :
       {"convert", "export", "learn", "lqr", "modes", "plan", "predict", "refine", "report", "simulate", "validate"})
    EXPECT_GT(outcomes[std::string(command) + ": 0"], 0) << command;
}

TEST_F(AnyModel, ThatBreaksARuleIsRefusedOnReading) {
  for_each(25, [&](std::uint64_t i, Dice& dice, Random& random, Model model) {
    SCOPED_TRACE(fmt::format("model {}", i));
    damage(model, dice, random);
    EXPECT_THROW(model.check(), std::invalid_argument);
    for (const char* name : {"model.npz", "model.h5", "model.mat"}) {
      SCOPED_TRACE(name);
      io::save_arrays(path(name), {}, [&](io::Layout layout) { return io::arrays_of(model, layout); });
      EXPECT_THROW(load_model(path(name)), IoError);
      EXPECT_EQ(run("info " + path(name)).status, 2);
    }
  });
}

// ---- state files of tokid update ----

// A state that contradicts itself or its samples.
UpdateState changed(UpdateState state, Dice& dice) {
  Plan& plan = state.plan;
  const Index steps = state.factors.steps();
  if (!state.provenance.options) state.provenance.options.emplace();
  IdentifyOptions& options = *state.provenance.options;
  if (!state.provenance.choices) state.provenance.choices.emplace();
  NoisyChoices& choices = *state.provenance.choices;
  for (Index i = 0; i <= dice.below(3); ++i) switch (dice.below(11)) {
      case 0:
        plan.states = dice.of<Index>({0, 1, 5, 40, 1'000'000'000'000});
        break;
      case 1:
        plan.method = plan.method == Method::tvera ? Method::subspace : Method::tvera;
        break;
      case 2:
        plan.coupled = !plan.coupled;
        break;
      case 3:
        plan.noisy = !plan.noisy;
        break;
      case 4:
        plan.nominal = !plan.nominal;
        break;
      case 5:
        options.period = dice.of<Index>({1, 3, steps, steps + 1, 1'000'000'000'000});
        break;
      case 6:
        choices.variation = {dice.of({0.0, 1.0, std::numeric_limits<double>::infinity()}),
                             dice.of<Index>({0, 1, 3, steps, steps + 1, 1'000'000'000'000})};
        break;
      case 7:
        options.rows = dice.of<Index>({1, 2, 100});
        options.cols = dice.of<Index>({1, 2, 100});
        break;
      case 8:
        options.frame = dice.of({Frame::raw, Frame::reference, Frame::smooth});
        options.reference_step = dice.of<Index>({0, 3, steps - 1, steps, steps + 5});
        break;
      case 9:
        state.factors.rows[size_t(dice.below(steps))] = dice.of<Index>({0, 1, state.factors.experiments});
        break;
      default:
        state.factors.factor.setZero();
    }
  return state;
}

TEST_F(AnyModel, StatesOfUpdatesWorkOrAreRefused) {
  const Ensemble data =
      testing::with_noise(testing::random_experiments(testing::random_system({2, 2, 1}, 9, 0.8, 5), 20, 6), 0.01, 7);
  save_ensemble(data, path("more.npz"));
  std::vector<UpdateState> states;
  for (const Method method : {Method::tvera, Method::subspace}) {
    IdentifyOptions options;
    options.method = method;
    options.lags = 2;
    options.states = 2;
    options.nominal = NominalChoice::none;
    options.refine = false;
    states.push_back(update_state(data, identify(data, options), options));
  }
  std::map<int, Index> outcomes;
  const Index first = number_from("TOKID_FIRST_MODEL", 1), count = number_from("TOKID_MODELS", 60);
  for (Index i = first; i < first + count; ++i) {
    SCOPED_TRACE(fmt::format("state {}", i));
    Dice dice{std::uint64_t(i)};
    if (std::getenv("TOKID_MODELS")) fmt::print(stderr, "\r{}\033[K", i);
    save_update_state(changed(states[size_t(i % 2)], dice), path("state.npz"));
    const app::Outcome outcome =
        run(fmt::format("update {} {} -o {}", path("state.npz"), path("more.npz"), path("out.npz")));
    EXPECT_TRUE(outcome.status == 0 || outcome.status == 2 || documented(outcome.complaint)) << outcome.complaint;
    ++outcomes[outcome.status];
  }
  EXPECT_GT(outcomes[0], 0);
  EXPECT_GT(outcomes[2], 0);
}

// ---- functions of the library, which Python calls ----

template <class Call>
void works_or_refuses(const char* name, Call&& call) {
  SCOPED_TRACE(name);
  try {
    call();
  } catch (const std::invalid_argument&) {
  } catch (const std::exception& error) {
    EXPECT_TRUE(documented(error.what())) << error.what();
  }
}

void use(const Model& model, const Model& other, const Ensemble& data, const fs::path& file) {
  const Index last = model.k_end() - 1;
  works_or_refuses("simulate",
                   [&] { simulate(model, data, Matrix::Ones(model.n(model.k_begin), data.experiments())); });
  works_or_refuses("innovations", [&] {
    const Innovations e = model_innovations(model, data);
    normalised_squares(model, e);
    input_gains(model, data, e);
  });
  works_or_refuses("experiment_fits", [&] { experiment_fits(model, data); });
  for (const Index k : {model.k_begin, model.full_begin(), last, model.k_end()}) {
    works_or_refuses("estimate_state", [&] { estimate_state(model, data, k, estimation_window(model)); });
    works_or_refuses("pulse_response", [&] { pulse_response(model, k, k - 1); });
    works_or_refuses("gain_pulse_response", [&] { gain_pulse_response(model, k, k - 1); });
    works_or_refuses("observability", [&] { observability(model, k, 3); });
    works_or_refuses("reference_frame", [&] { reference_frame(model, k, 2).model.check(); });
    works_or_refuses("from_step", [&] { from_step(model, k).check(); });
    works_or_refuses("cut", [&] { cut(model, k, k + 4).check(); });
    works_or_refuses("join", [&] { join(model, other, k, 2).model.check(); });
    works_or_refuses("join with itself", [&] { join(model, model, k, 3).model.check(); });
    works_or_refuses("frozen_system", [&] { frozen_system(model, k).check(); });
    works_or_refuses("unknowns", [&] {
      if (k < model.k_end()) unknowns(model, k);
    });
  }
  works_or_refuses("pulse_responses", [&] { pulse_responses(model, 4); });
  works_or_refuses("continued", [&] { continued(model, model.k_end() + 9).check(); });
  works_or_refuses("smooth_frame", [&] { smooth_frame(model, 2).check(); });
  works_or_refuses("align", [&] { align(model, other, 2).model.check(); });
  works_or_refuses("align to itself", [&] { align(model, smooth_frame(model, 2), 2).model.check(); });
  works_or_refuses("kinematically_similar", [&] { kinematically_similar(model, other); });
  works_or_refuses("kinematically_similar to itself", [&] { kinematically_similar(model, model); });
  works_or_refuses("deadbeat", [&] {
    deadbeat_products(model, 2);
    deadbeat_gain(model);
  });
  works_or_refuses("kalman_observer", [&] { kalman_observer(model).check(); });
  works_or_refuses("floquet", [&] {
    floquet(model);
    floquet_exponents(model);
  });
  works_or_refuses("closed_loop_spectrum", [&] { closed_loop_spectrum(model); });
  works_or_refuses("log_likelihoods", [&] { log_likelihoods(model, data); });
  works_or_refuses("with_constant_states", [&] { with_constant_states(model, data.steps()).check(); });
  works_or_refuses("example", [&] {
    experiments(model, {.experiments = 3});
    experiments(model, data);
    expected_moments(with_noise(model, {.process_noise = 0.1, .measurement_noise = 0.1}));
  });
  works_or_refuses("lifted map", [&] {
    const LiftedMap map(model, model.k_begin, model.k_end() + 3);
    map.transposed_product(map.product(Matrix::Ones(map.steps(), map.inputs())));
    map.dense();
  });
  works_or_refuses("lqr", [&] {
    const Lqr designed =
        lqr(model, {{Matrix::Identity(model.outputs, model.outputs)}, {Matrix::Identity(model.inputs, model.inputs)}});
    expected_cost(designed.controller, model, model);
    simulate_control(designed.controller, model, model, {.experiments = 2});
    save_controller(designed.controller, file);
    const Controller read = load_controller(file);
    predicted_cost(read, model);
    deploy(model, {.start_from_zero = true}, &read);
    expected_cost(read, model, other);
    simulate_control(read, other, model, {.experiments = 2});
  });
  for (const bool missing : {false, true})
    works_or_refuses("online observer", [&] {
      OnlineObserver observer(model, {.samples_missing = missing, .input_square = Vector::Ones(model.inputs)});
      for (Index k = 0; k < data.steps(); ++k) {
        observer.state();
        observer.predict(Matrix::Ones(std::min<Index>(3, std::max<Index>(1, last - k)), model.inputs));
        observer.step(data.input(k).row(0).transpose(), data.output(k).row(0).transpose());
      }
    });
}

TEST_F(AnyModel, WorksOrIsRefusedInEveryFunction) {
  for_each(100, [&](std::uint64_t i, Dice& dice, Random& random, const Model& model) {
    SCOPED_TRACE(fmt::format("model {}", i));
    if (std::getenv("TOKID_MODELS")) fmt::print(stderr, "\r{}\033[K", i);
    Dice others(i + 1'000'000);
    use(model, random_model(others, random), random_data(model, dice, random), path("controller.npz"));
  });
}

}  // namespace
}  // namespace tokid
