// SPDX-License-Identifier: BSD-3-Clause
#include "studies/accuracy.hpp"

#include <unistd.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>

#include "linalg/lane_regression.hpp"
#include "linalg/simd.hpp"
#include "members.hpp"
#include "oracle.hpp"
#include "studies/accuracy_cases.hpp"
#include "testing.hpp"
#include "tokid/copies.hpp"
#include "tokid/io.hpp"
#include "tokid/markov.hpp"
#include "tokid/observer.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/stream.hpp"
#include "tokid/tvera.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {

namespace {

using oracle::exact;
using oracle::Exact;
using oracle::Real;

namespace fs = std::filesystem;

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double worst_condition = 1e12;  // double precision sees the rank up to there

// Is a problem of this condition to be judged? It is counted either way.
bool within_reach(double condition, AccuracyFindings& findings) {
  const bool within = condition < worst_condition;
  ++(within ? findings.judged : findings.left_out);
  return within;
}

// A directory for files, removed with what is in it.
class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("tokid-accuracy-" + std::to_string(getpid()))) {
    fs::create_directories(path_);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() { fs::remove_all(path_); }
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

// Inputs that differ by 1 / condition from those of the first channel, or, where it is the only one, of the step
// before.
void draw_inputs(Ensemble& e, double condition, Random& random) {
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k) = random.matrix(e.experiments(), e.inputs());
    if (condition == 1.0) continue;
    for (Index i = 1; i < e.inputs(); ++i) e.input(k).col(i) = e.input(k).col(0) + e.input(k).col(i) / condition;
    if (e.inputs() == 1 && k > 0) e.input(k) = (e.input(k - 1) + e.input(k) / condition).eval();
  }
}

// Experiments whose windows have about the given condition, for one of these reasons.
enum class Weakness { graded, alike_inputs, alike_experiments, system };
Ensemble ill_conditioned_experiments(const Sizes& size, Index experiments, Index steps, Weakness weakness,
                                     double condition, Random& random) {
  const Index d = size.channels();
  Ensemble e(experiments, steps, size.r, size.m);
  switch (weakness) {
    case Weakness::graded: {  // U diag(s) V
      const Index rank = std::min(experiments, size.regressors() + size.m);
      Vector s(rank);
      for (Index i = 0; i < rank; ++i) s(i) = std::pow(condition, -double(i) / double(std::max<Index>(1, rank - 1)));
      const Matrix u = linalg::orthonormal_factor(random.matrix(experiments, rank));
      e.samples() = u * s.asDiagonal() * random.matrix(rank, steps * d);
      break;
    }
    case Weakness::alike_inputs:
      draw_inputs(e, condition, random);
      for (Index k = 0; k < steps; ++k) e.output(k) = random.matrix(experiments, size.m);
      break;
    case Weakness::alike_experiments:
      e.samples() = random.matrix(experiments, steps * d) / condition;
      e.samples().rowwise() += random.matrix(1, steps * d).row(0);
      break;
    case Weakness::system: {
      draw_inputs(e, condition, random);
      const auto seed = std::uint64_t(random.uniform(0, 1e9));
      const Model system = random_system({size.n, size.m, size.r}, steps, random.uniform(0.7, 1.2), seed);
      e = simulate(system, e, random.matrix(size.n, experiments));
      break;
    }
  }
  return e;
}

std::vector<Ensemble> in_parts(const Ensemble& e, Index parts) {
  std::vector<Ensemble> result;
  parts = std::min(parts, e.experiments());
  for (Index i = 0; i < parts; ++i)
    result.push_back(e.subset(range(e.experiments() * i / parts, e.experiments() * (i + 1) / parts)));
  return result;
}

// Adds experiments as the processes of tokid-mpi do, from files.
void add_from_files(UpdateState& state, const Model& before, const std::vector<Ensemble>& parts, const Folder& folder) {
  std::vector<fs::path> files;
  for (const Ensemble& part : parts) {
    files.push_back(folder / ("part" + std::to_string(files.size()) + ".npz"));
    save_ensemble(part, files.back());
  }
  Threads(2).run([&](const Team& team) {
    UpdateState none;
    const bool first = team.rank == 0;
    update(first ? state : none, first ? before : Model(), files, {{}, {}, team});
  });
}

// The same regressions, in every way that there is.
std::vector<std::pair<std::string, GtvArx>> every_route(const Ensemble& e, Index lags, Random& random,
                                                        const Folder* folder) {
  std::vector<std::pair<std::string, GtvArx>> routes;
  GtvArxOptions o;
  o.lags = {lags};
  o.initial_state = InitialState::unknown;
  o.block = 1;
  routes.emplace_back("each step by itself", gtv_arx(e, o));
  o.block = whole(random, 2, 2 * lags + 2);
  routes.emplace_back("shared window", gtv_arx(e, o));
  o.block = 0;
  const bool in_lanes = (lags + 1) * e.channels() <= linalg::LaneRegression::most_columns() &&
                        e.experiments() > minimum_experiments(e.inputs(), e.outputs(), lags) &&
                        e.steps() - lags >= linalg::LaneRegression::most_lanes;
  if (in_lanes) routes.emplace_back("SIMD lanes", gtv_arx(e, o));
  const Index batch = whole(random, 1, 1 + e.experiments() / 4);
  WindowFactors factors = window_factors(e.subset(range(0, batch)), lags, o.initial_state);
  for (Index n = batch; n < e.experiments(); n += batch)
    merge(factors,
          window_factors(e.subset(range(n, std::min(e.experiments(), n + batch))), lags, InitialState::unknown));
  routes.emplace_back("streamed update", gtv_arx(Windows(factors), o));
  // An update leaves out experiments that differ from others, or from combinations of them, by rounding errors alone.
  const Index first = std::max<Index>(1, e.experiments() / 4);
  const std::vector<Ensemble> parts = in_parts(e.subset(range(first, e.experiments())), 3);
  if (folder &&
      std::all_of(parts.begin(), parts.end(), [](const Ensemble& part) { return used_experiments(part).all(part); })) {
    UpdateState state;
    state.factors = window_factors(e.subset(range(0, first)), lags, o.initial_state);
    add_from_files(state, random_system({1, e.outputs(), e.inputs()}, e.steps(), 0.5, 1), parts, *folder);
    routes.emplace_back("merged files (MPI)", gtv_arx(Windows(state.factors), o));
  }
  return routes;
}

// One regression of one route, with regressors of norm 1: min ‖A z - b‖, A = W S, z = S⁻¹ Mᵀ.
void judge(const GtvArx& arx, Index k, const Matrix& a, const Vector& scale, const oracle::LeastSquares& truth,
           Accuracy about, std::vector<Accuracy>& all) {
  const GtvArxStep& step = arx.step[size_t(k)];
  const Matrix coefficients = arx.coefficients(k).transpose();
  const double condition = truth.condition, size = truth.size;
  const bool full = step.rank == a.cols();
  const auto add = [&](const char* stage, double error, double unit, double of) {
    Accuracy result = about;
    result.stage = stage;
    result.condition = condition;
    see(result, full ? error : inf, unit, of);
    all.push_back(result);
  };
  for (Index j = 0; j < coefficients.cols(); ++j) {
    Vector z(a.cols()), difference(a.cols());
    for (Index i = 0; i < a.cols(); ++i) {
      z(i) = double(truth.x(i, j));
      difference(i) = double(Real(coefficients(i, j)) / Real(scale(i)) - truth.x(i, j));
    }
    const double y = truth.right(j), rest = truth.residual(j);
    about.noisy = rest > 1e-12 * y || step.freedom == 0;  // what fits anything fits noise
    add("coefficients", difference.norm(), condition * (z.norm() + y / size + condition * rest / size), z.norm());
    add("fit", (a * difference).norm(), size * z.norm() + y + condition * rest, y);
    if (step.freedom > 0)
      add("residuals", std::abs(std::sqrt(arx.residual_cov(k)(j, j) * double(step.freedom)) - rest),
          size * z.norm() + y, y);
  }
  add("condition number", std::abs(step.condition - condition), condition * condition, condition);
}

AccuracyFindings regressions(int cases) {
  AccuracyFindings findings;
  const Folder folder;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(1000 + c));
    const Sizes size = draw_sizes(random);
    const Index p = size.p, d = size.channels(), steps = p + 9 + whole(random, 0, 3);
    const Index experiments = draw_experiments(random, size.regressors());
    const Weakness weakness = Weakness(c % 4);
    Ensemble e = ill_conditioned_experiments(size, experiments, steps, weakness, power(random, 0.0, 11.7), random);
    const double noise = c % 3 == 0 ? 0.0 : power(random, -8.0, 0.0);
    for (Index k = 0; k < steps; ++k)
      e.output(k) += noise * e.output(k).norm() / std::sqrt(double(experiments)) * random.matrix(experiments, size.m);
    for (Index i = 0; i < d; ++i) {  // units
      const double unit = power(random, -3.0, 3.0);
      for (Index k = 0; k < steps; ++k) e.samples().col(k * d + i) *= unit;
    }
    if (c % 5 == 0 && experiments > size.regressors() + 1) e.y(0, steps / 2, 0) = std::nan("");

    const auto routes = every_route(e, p, random, c % 4 == 1 || c % 7 == 0 ? &folder : nullptr);
    for (const Index k : {whole(random, p, steps - 1), whole(random, p, steps - 1)}) {
      Matrix rows;
      Windows(e).rows(k, p, rows);
      Matrix a = rows.leftCols(size.regressors());
      const Vector scale = a.colwise().norm().cwiseInverse();
      Exact scaled = exact(a);
      for (Index j = 0; j < a.cols(); ++j) scaled.col(j) *= Real(scale(j));
      a *= scale.asDiagonal();
      const oracle::LeastSquares truth = oracle::least_squares(scaled, exact(rows.rightCols(size.m)));
      if (!within_reach(truth.condition, findings)) continue;
      for (const auto& [name, arx] : routes) {
        Accuracy about;
        about.route = name;
        judge(arx, k, a, scale, truth, about, findings.all);
      }
    }
  }
  return findings;
}

AccuracyFindings regularised_regressions(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(2000 + c));
    const Index m = whole(random, 1, 2), r = whole(random, 1, 2), p = whole(random, 1, 2), steps = p + 3;
    const Sizes size{p * m, m, r, p};
    const Index experiments = std::max<Index>(2, whole(random, size.regressors() / 2, 3 * size.regressors()));
    const Ensemble e =
        ill_conditioned_experiments(size, experiments, steps, Weakness(c % 4), power(random, 0.0, 4.0), random);
    SmoothArxOptions o;
    o.lags = p;
    o.variation.smoothing = power(random, -3.0, 3.0);

    // The problem of all steps, as smooth_arx() states it.
    const Windows windows(e);
    const Vector channel = windows.channel_sizes();
    const Index width = size.regressors(), unknowns = steps * width, d = size.channels();
    const Real stiffness = sqrt(Real(o.variation.smoothing) * Real(experiments));
    Exact a = Exact::Zero(steps * experiments + unknowns - width, unknowns), b = Exact::Zero(a.rows(), m);
    Vector scale(width);
    for (Index j = 0; j < width; ++j) scale(j) = channel(j % d);
    for (Index k = 0; k < steps; ++k) {
      const Matrix rows = windows.rows(k, p);
      for (Index j = 0; j < width; ++j)
        for (Index n = 0; n < experiments; ++n)
          a(k * experiments + n, k * width + j) = Real(rows(n, j)) / Real(scale(j));
      b.middleRows(k * experiments, experiments) = exact(rows.rightCols(m));
      for (Index j = 0; k > 0 && j < width; ++j) {
        const Index row = steps * experiments + (k - 1) * width + j;
        a(row, k * width + j) = stiffness;
        a(row, (k - 1) * width + j) = -stiffness;
      }
    }
    const oracle::LeastSquares truth = oracle::least_squares(a, b);
    if (!within_reach(truth.condition, findings)) continue;

    WindowFactors factors = window_factors(e.subset(range(0, experiments / 2)), p, InitialState::zero);
    merge(factors, window_factors(e.subset(range(experiments / 2, experiments)), p, InitialState::zero));
    const auto judge_route = [&](const char* route, const GtvArx& arx) {
      Accuracy about;
      about.stage = "regularised coefficients";
      about.route = route;
      about.condition = truth.condition;
      for (Index j = 0; j < m; ++j) {
        double error = 0.0, x = 0.0;
        for (Index k = 0; k < steps; ++k) {
          const Index own = arx.regressors(k), first = width - own;
          for (Index i = 0; i < width; ++i) {
            const Real& known = truth.x(k * width + i, j);
            x += double(known * known);
            if (i < first) continue;
            const double off = double(Real(arx.coefficients(k)(j, i - first)) * Real(scale(i)) - known);
            error += off * off;
          }
        }
        const double unit = truth.condition * (std::sqrt(x) + truth.right(j) / truth.size +
                                               truth.condition * truth.residual(j) / truth.size);
        see(about, std::sqrt(error), unit, std::sqrt(x));
      }
      findings.all.push_back(about);
    };
    judge_route("all steps together", smooth_arx(windows, o));
    judge_route("streamed update", smooth_arx(Windows(factors), o));
  }
  return findings;
}

// What an error at the steps up to k adds up to at step k: the ARX recursion hands it on as the answer to a pulse at
// its output, which is the observer gain Markov parameter h°.
template <class Local>
double handed_on(const Markov& markov, Index k, Index i, Local&& local) {
  double sum = local(k);
  for (Index l = i + 1; l < k; ++l) sum += markov.h_gain(k, l).norm() * local(l);
  return sum;
}

// What errors at step k are held against: the largest pulse response there.
double largest(const Markov& markov, Index k, bool gain) {
  double size = 0.0;
  for (Index i = std::max(markov.i_begin, k - markov.band); i < k; ++i)
    size = std::max(size, gain ? markov.h_gain(k, i).norm() : markov.h(k, i).norm());
  return size;
}

// The terms that step k adds up to h_{k,i} and h°_{k,i}.
struct Terms {
  double system = 0.0, gain = 0.0;
};
Terms terms(const GtvArx& arx, const Markov& markov, Index k, Index i) {
  Terms t;
  for (Index j = 1; j <= std::min(k - i, arx.step[size_t(k)].lags); ++j) {
    const double h2 = arx.output_block(k, j).norm();
    const bool direct = j == k - i;
    t.system += direct ? arx.input_block(k, j).norm() + h2 * arx.D(i).norm() : h2 * markov.h(k - j, i).norm();
    t.gain += direct ? h2 : h2 * markov.h_gain(k - j, i).norm();
  }
  return t;
}

AccuracyFindings markov_parameters(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(3000 + c));
    Sizes size = draw_sizes(random);
    size.p += c % 2;
    const Index steps = 2 * size.p + 6, band = 2 * size.p + 4;
    const Model system =
        random_system({size.n, size.m, size.r}, steps, random.uniform(0.6, 1.3), std::uint64_t(3500 + c));
    const Ensemble data =
        with_noise(random_experiments(system, draw_experiments(random, size.regressors()), std::uint64_t(3700 + c)),
                   c % 3 == 0 ? 0.1 : 0.0, std::uint64_t(3900 + c));
    GtvArxOptions o;
    o.lags = {size.p};
    const GtvArx arx = gtv_arx(data, o);
    const Markov found = markov(arx, band);
    const oracle::Responses truth = oracle::responses(arx, found.band);
    Accuracy about;
    about.route = "recursion";
    about.stage = "Markov parameters";
    Accuracy pulse = about;
    about.stage = "gain Markov parameters";
    Accuracy gain = about;
    for (Index k = 1; k < steps; ++k)
      for (Index i = std::max<Index>(0, k - found.band); i < k; ++i) {
        const Index r = size.r, m = size.m, at = k - i - 1;
        see(pulse, oracle::distance(found.h(k, i), truth.system[size_t(k)].middleCols(at * r, r)),
            handed_on(found, k, i, [&](Index l) { return terms(arx, found, l, i).system; }), largest(found, k, false));
        see(gain, oracle::distance(found.h_gain(k, i), truth.gain[size_t(k)].middleCols(at * m, m)),
            handed_on(found, k, i, [&](Index l) { return terms(arx, found, l, i).gain; }), largest(found, k, true));
      }
    findings.all.push_back(pulse);
    findings.all.push_back(gain);
    ++findings.judged;
  }
  return findings;
}

// First-order errors of the matrices of a TVERA model in its own, balanced coordinates, O_k = U Σ^{1/2},
// R_{k-1} = Σ^{1/2} Vᵀ, from errors of the Hankel matrices: a singular subspace turns by ‖E_k R_{k-1}⁺‖.
struct RealisationErrors {
  std::vector<double> a, b, c, g;  // (S)
  double condition = 1.0;          // largest σ_1 / σ_n of any H_k
};
// `error`: ‖E_k‖, `gain`: that of the stacked h°_{k,·} of the column before step k, for every step of the model.
RealisationErrors realisation_errors(const Model& model, Index rows, const std::vector<double>& error,
                                     const std::vector<double>& gain) {
  RealisationErrors result;
  const size_t steps = model.step.size();
  std::vector<double> root(steps + 1, 0.0), turned(steps + 1, 0.0);  // σ_n^{-1/2}, ‖E R⁺‖
  for (size_t s = 0; s < steps; ++s) {
    const Index n = model.step[s].states();
    if (n == 0) continue;
    const Vector& sigma = model.step[s].singular_values();
    result.condition = std::max(result.condition, sigma(0) / sigma(n - 1));
    root[s] = 1 / std::sqrt(sigma(n - 1));
    turned[s] = error[s] * root[s];
  }
  for (size_t s = 0; s < steps; ++s) {
    const Index k = model.k_begin + Index(s), next = model.step[s].next_states();
    result.c.push_back(turned[s]);
    double inverse = 0.0;  // of O_{k+1}↑
    const Index blocks = std::min(rows, model.k_end() - k) - 1;
    if (next > 0 && model.step[s].states() > 0)
      inverse = 1 / linalg::singular_values(observability(model, k + 1, blocks))(next - 1);
    result.a.push_back(inverse * (turned[s] + turned[s + 1] * model.step[s].A().norm()));
    result.b.push_back(next > 0 ? root[s + 1] * (error[s + 1] + turned[s + 1] * model.step[s].B().norm()) : 0.0);
    result.g.push_back(next > 0 ? root[s + 1] * (gain[s + 1] + turned[s + 1] * model.step[s].G().norm()) : 0.0);
  }
  return result;
}

// What they add up to in C_k Φ(k,i+1) B_i, with B and its errors or with G.
double pulse_error(const Model& model, const RealisationErrors& errors, Index k, Index i, bool gain) {
  const size_t s = model.index(k), first = model.index(i);
  const Matrix start = gain ? model.step[first].G() : model.step[first].B();
  std::vector<double> past;  // ‖Φ(l,i+1) B_i‖, l = i+1 … k
  Matrix state = start;
  for (size_t l = first + 1; l <= s; ++l) {
    past.push_back(state.norm());
    state = (model.step[l].A() * state).eval();
  }
  Matrix row = model.step[s].C();  // C_k Φ(k,l+1)
  double sum = errors.c[s] * past.back();
  for (size_t l = s; l-- > first + 1;) {
    sum += row.norm() * errors.a[l] * past[l - first - 1];
    row = (row * model.step[l].A()).eval();
  }
  return sum + row.norm() * (gain ? errors.g : errors.b)[first];
}

// Do all H_k have the rank of the system?
bool has_rank(const Model& model, Index n, Index rows, Index cols, Index free) {
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const Index past = std::min(cols, k - model.k_begin) * model.inputs + free;
    const Index future = std::min(rows, model.k_end() - k) * model.outputs;
    if (model.n(k) != std::min({n, past, future})) return false;
  }
  return true;
}

AccuracyFindings realisations(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(4000 + c));
    const Index m = whole(random, 1, 3), r = whole(random, 1, 3), n = whole(random, 1, 12);
    const Index rows = (n + m - 1) / m + 1, cols = (n + r - 1) / r, steps = rows + cols + 6, band = rows + cols - 1;
    Model system = random_system({n, m, r}, steps, random.uniform(0.3, 1.3), std::uint64_t(4500 + c));
    for (Step& step : system.step) step.G() = random.uniform(0.1, 1.0) * random.matrix(n, m);
    const oracle::Responses truth = oracle::responses(system, band);
    Markov given(steps, r, m, band, 0);
    for (Index k = 0; k < steps; ++k) {
      given.D(k) = system.step[size_t(k)].D();
      given.system(k) = truth.system[size_t(k)].cast<double>();
      given.gain(k) = truth.gain[size_t(k)].cast<double>();
    }
    FreeResponse free;
    if (c % 3 == 0) {
      free.experiments = n;
      free.steps = steps;
      free.y.resize(n, steps * m);
      Ensemble rest(n, steps, r, m);
      rest.samples().setZero();
      const std::vector<Exact> y = oracle::outputs(system, rest, random.matrix(n, n), false);
      for (Index k = 0; k < steps; ++k) free.y.middleCols(k * m, m) = y[size_t(k)].cast<double>();
    }
    TveraOptions o;
    o.rows = rows;
    o.cols = cols;
    o.states = n;
    const Model model = tvera(given, free, o);
    std::vector<double> error(size_t(steps) + 1, 0.0), gain = error;
    for (Index k = 0; k < steps; ++k) {
      error[size_t(k)] = model.step[size_t(k)].singular_values().norm();
      for (Index a = 0; k > 0 && a < std::min(rows, steps - k); ++a)
        gain[size_t(k)] = std::hypot(gain[size_t(k)], given.h_gain(k + a, k - 1).norm());
    }
    const RealisationErrors errors = realisation_errors(model, rows, error, gain);
    if (!within_reach(errors.condition, findings)) continue;
    const double wrong = has_rank(model, n, rows, cols, free.experiments) ? 0.0 : inf;
    Accuracy about;
    about.route = free.experiments > 0 ? "general routines" : "SIMD lanes";
    about.stage = "realisation: A, B, C";
    about.condition = errors.condition;
    see(about, wrong, 0.0, 1.0);
    Accuracy pulse = about;
    about.stage = "realisation: gains G";
    Accuracy observer = about;
    for (Index k = 1; k < steps; ++k)
      for (Index i = std::max<Index>(0, k - band); i < k; ++i) {
        const Index at = k - i - 1;
        see(pulse, oracle::distance(pulse_response(model, k, i), truth.system[size_t(k)].middleCols(at * r, r)),
            pulse_error(model, errors, k, i, false), largest(given, k, false));
        // No gain acts on states that no input has reached yet.
        if (std::min(cols, i + 1) * r + free.experiments >= n)
          see(observer, oracle::distance(gain_pulse_response(model, k, i), truth.gain[size_t(k)].middleCols(at * m, m)),
              pulse_error(model, errors, k, i, true), largest(given, k, true));
      }
    findings.all.push_back(pulse);
    findings.all.push_back(observer);
  }
  return findings;
}

AccuracyFindings simulations(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(5000 + c));
    const Index n = whole(random, 1, 12), m = whole(random, 1, 3), r = whole(random, 1, 3), steps = 30, experiments = 2;
    Model model = random_system({n, m, r}, steps, random.uniform(0.5, 1.5), std::uint64_t(5500 + c));
    for (Step& step : model.step) step.G() = random.uniform(0.0, 0.3) * random.matrix(n, m);
    const Ensemble inputs = random_experiments(model, experiments, std::uint64_t(5700 + c));
    const Matrix x0 = Matrix::Zero(experiments, n);
    for (const bool corrected : {false, true}) {
      const Ensemble found = corrected ? predict(model, inputs).y : simulate(model, inputs);
      const std::vector<Exact> truth = oracle::outputs(model, inputs, x0, corrected);
      Accuracy about;
      about.stage = corrected ? "one-step prediction" : "simulation";
      about.route = "recursion";

      for (Index i = 0; i < experiments; ++i) {
        Vector x = Vector::Zero(n);
        std::vector<double> local;  // ‖terms of x_{l+1}‖
        for (Index k = 0; k < steps; ++k) {
          const size_t s = size_t(k);
          const Vector u = inputs.input(k).row(i).transpose(), y = inputs.output(k).row(i).transpose();
          const Vector expected = model.step[s].C() * x + model.step[s].D() * u;
          const double output = model.step[s].C().norm() * x.norm() + model.step[s].D().norm() * u.norm();
          double unit = output;
          Matrix row = model.step[s].C();  // C_k Φ(k,l+1)
          for (size_t l = s; l-- > 0;) {
            unit += row.norm() * local[l];  // cppcheck-suppress containerOutOfBounds; it grows below
            row = (row * (corrected ? model.at(Index(l)).closed_loop() : model.step[l].A())).eval();
          }
          see(about, oracle::distance(found.output(k).row(i), truth[s].row(i)), unit, expected.norm());
          local.push_back(model.step[s].A().norm() * x.norm() + model.step[s].B().norm() * u.norm() +
                          (corrected ? model.step[s].G().norm() * (y.norm() + output) : 0.0));
          x = (model.step[s].A() * x + model.step[s].B() * u).eval();
          if (corrected) x -= model.step[s].G() * (y - expected);
        }
      }
      findings.all.push_back(about);
    }
    ++findings.judged;
  }
  return findings;
}

AccuracyFindings kalman_filters(int cases) {
  AccuracyFindings findings;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(6000 + c));
    const Index n = whole(random, 1, 12), m = whole(random, 1, 3), steps = 12;
    Model model = random_system({n, m, 1}, steps, random.uniform(0.5, 1.3), std::uint64_t(6500 + c));
    for (Index k = 0; k < steps; ++k) {
      model.at(k).set_Q(draw_covariance(random, n));
      model.at(k).set_R(draw_covariance(random, m));
    }
    model.x0_cov = draw_covariance(random, n);
    model.x0_mean = Vector::Zero(n);
    const KalmanFilter found = kalman_filter(model);
    const oracle::Filter truth = oracle::kalman_filter(model);
    Accuracy about;
    about.route = "square roots";
    about.stage = "Kalman filter: P";
    Accuracy covariances = about;
    about.stage = "Kalman filter: K";
    Accuracy gains = about;
    // Covariances by their traces, the squares of the norms of their square roots; those given are taken apart by their
    // eigenvectors, which adds a rounding error for each of them.
    const double own_n = double(n), own_m = double(m);
    std::vector<double> local{own_n * model.x0_cov.trace()};
    std::vector<Matrix> closed;
    for (size_t s = 0; s < size_t(steps); ++s) {
      const Matrix &p = found.P[s], &k = found.K[s], &c_s = model.step[s].C(), &innovation = found.innovation_cov[s];
      double unit = local[s];
      Matrix product = Matrix::Identity(n, n);  // of closed loops
      for (size_t l = s; l-- > 0;) {
        product = (product * closed[l]).eval();  // cppcheck-suppress containerOutOfBounds; it grows below
        unit += product.squaredNorm() * local[l];
      }
      see(covariances, oracle::distance(p, truth.P[s]), unit, p.norm());
      // K = P Cᵀ S⁻¹ by least squares: min ‖F Kᵀ - [0; P^{1/2}ᵀ]‖, FᵀF = S.
      const Matrix rest = Matrix::Identity(n, n) - k * c_s, inverse = innovation.inverse();
      const Matrix updated = rest * p * rest.transpose() + k * model.step[s].R() * k.transpose();
      const double f = std::sqrt(innovation.trace()), condition = f * std::sqrt(inverse.trace());
      const double own = condition * (k.norm() + (std::sqrt(p.trace()) + condition * std::sqrt(updated.trace())) / f) +
                         own_m * k.norm() * model.step[s].R().trace() * inverse.norm();
      see(gains, oracle::distance(k, truth.K[s]), rest.norm() * unit * (c_s.transpose() * inverse).norm() + own,
          k.norm());
      closed.emplace_back(model.step[s].A() * rest);
      local.push_back(
          model.step[s].A().squaredNorm() *
              (2 * p.trace() + k.squaredNorm() * (2 * innovation.trace() + own_m * model.step[s].R().trace())) +
          own_n * model.step[s].Q().trace());
    }
    findings.all.push_back(covariances);
    findings.all.push_back(gains);
    ++findings.judged;
  }
  return findings;
}

// First-order errors of the Markov parameters of data without noise, in units of ε: h_{k,i} = M_k ω with ω the window
// that a pulse leaves behind, and M_kᵀ errs by W_k⁺ times what rounding makes of samples and fit.
class DataErrors {
 public:
  DataErrors(const Ensemble& e, const GtvArx& arx, const Markov& markov) : arx_(arx), markov_(markov) {
    const Windows windows(e);
    for (Index k = 0; k < arx.steps(); ++k) {
      own_.emplace_back();
      if (k < arx.k_begin) continue;
      const Matrix rows = windows.rows(k, arx.step[size_t(k)].lags);
      const Index left = arx.regressors(k);
      const Vector norms = rows.leftCols(left).colwise().norm().transpose();
      const double fit = std::sqrt(double(left)) * (arx.coefficients(k) * norms.asDiagonal()).norm() +
                         rows.rightCols(e.outputs()).norm();
      for (Index i = k; i >= std::max(arx.k_begin, k - markov.band); --i)
        own_.back().push_back((arx.noise_shape(k).transpose() * answer(k, i)).norm() * fit +
                              (i < k ? terms(arx, markov, k, i).system : 0.0));
    }
  }

  double operator()(Index k, Index i) const {
    const auto local = [&](Index l) { return own_[size_t(l)][size_t(l - i)]; };
    return handed_on(markov_, k, i, local) + markov_.h_gain(k, i).norm() * local(i);
  }

 private:
  // ω at step k of a pulse at step i.
  Matrix answer(Index k, Index i) const {
    const Index lags = arx_.step[size_t(k)].lags, r = arx_.inputs, m = arx_.outputs, d = r + m;
    Matrix window = Matrix::Zero(arx_.regressors(k), r);
    if (k == i) window.bottomRows(r).setIdentity();
    for (Index j = 1; j <= std::min(k - i, lags); ++j) {
      auto v = window.middleRows((lags - j) * d, d);
      if (j < k - i) {
        v.bottomRows(m) = markov_.h(k - j, i);
      } else {
        v.topRows(r).setIdentity();
        v.bottomRows(m) = arx_.D(i);
      }
    }
    return window;
  }

  const GtvArx& arx_;
  const Markov& markov_;
  std::vector<std::vector<double>> own_;  // of each step, by k - i
};

AccuracyFindings identifications(int cases) {
  AccuracyFindings findings;
  const Folder folder;
  for (int c = 0; c < cases; ++c) {
    Random random(std::uint64_t(7000 + c));
    const Index m = whole(random, 1, 3), r = whole(random, 1, 3), p = whole(random, 1, 3), n = p * m, lags = p + c % 2;
    const Index fewest = minimum_experiments(r, m, lags), experiments = draw_experiments(random, fewest);
    const Index rows = lags + 1, cols = std::max(lags, n), steps = 70, band = rows + cols - 1;
    const bool rest = c % 4 < 2;
    const Model system = random_system({n, m, r}, steps, random.uniform(0.7, 1.1), std::uint64_t(7500 + c));
    Ensemble e(experiments, steps, r, m);
    draw_inputs(e, c % 3 == 0 ? power(random, 0.0, 6.0) : 1.0, random);
    const std::vector<Exact> y =
        oracle::outputs(system, e, rest ? Matrix::Zero(experiments, n) : random.matrix(experiments, n), false);
    for (Index k = 0; k < steps; ++k) e.output(k) = y[size_t(k)].cast<double>();
    const oracle::Responses truth = oracle::responses(system, band);

    IdentifyOptions options;
    options.lags = lags;
    options.states = n;
    options.method = Method::tvera;
    options.initial_state = rest ? InitialState::zero : InitialState::unknown;
    options.nominal = NominalChoice::none;
    options.refine = false;
    options.rows = rows;
    options.cols = cols;

    GtvArxOptions o;
    o.lags = {lags};
    o.initial_state = *options.initial_state;
    const GtvArx arx = gtv_arx(e, o);
    const Markov estimated = markov(arx, band);
    TveraOptions t;
    t.rows = rows;
    t.cols = cols;
    t.states = n;
    const Model whole_model = tvera(estimated, {}, t);
    const DataErrors data_errors(e, arx, estimated);
    std::vector<double> error(whole_model.step.size() + 1, 0.0);
    for (size_t s = 0; s < whole_model.step.size(); ++s) {
      const Index k = whole_model.k_begin + Index(s);
      error[s] = whole_model.step[s].singular_values().norm();
      for (Index a = 0; a < std::min(rows, steps - k); ++a)
        for (Index b = 0; b < std::min(cols, k - whole_model.k_begin); ++b)
          error[s] = std::hypot(error[s], data_errors(k + a, k - 1 - b));
    }
    const RealisationErrors errors = realisation_errors(whole_model, rows, error, error);
    if (!within_reach(errors.condition, findings)) continue;
    const double wrong = has_rank(whole_model, n, rows, cols, 0) ? 0.0 : inf;

    const auto judge_route = [&](const std::string& route, const Model& model) {
      Accuracy about;
      about.stage = "whole identification";
      about.route = route;
      for (Index k = arx.k_begin; k < steps; ++k)
        about.condition = std::max(about.condition, arx.step[size_t(k)].condition);
      about.condition *= errors.condition;
      see(about, wrong, 0.0, 1.0);

      for (Index k = model.k_begin + 1; k < steps; ++k)
        for (Index i = std::max(model.k_begin, k - band); i < k; ++i)
          see(about,
              oracle::distance(pulse_response(model, k, i), truth.system[size_t(k)].middleCols((k - i - 1) * r, r)),
              pulse_error(whole_model, errors, k, i, false), largest(estimated, k, false));
      findings.all.push_back(about);
    };
    judge_route("identify", identify(e, options).model);
    save_ensemble(e, folder / "whole.h5");
    StreamOptions stream;
    stream.identify = options;
    stream.block = steps / 2;
    identify_stream(EnsembleFile(folder / "whole.h5"), folder / "model.h5", stream);
    judge_route("identify --block", load_model(folder / "model.h5"));
    const Index first = std::max(fewest, experiments / 2);
    if (experiments < first + 3) continue;
    const Ensemble begun = e.subset(range(0, first)), more = e.subset(range(first, experiments));
    const UpdateState state = update_state(begun, identify(begun, options), options);
    UpdateState one_by_one = state, from_files = state;
    for (Index i = 0; i < more.experiments(); ++i) update(one_by_one, more.subset({i}));
    judge_route("update, one by one", identify(one_by_one).model);
    add_from_files(from_files, identify(state).model, in_parts(more, 3), folder);
    judge_route("update from files (MPI)", identify(from_files).model);
  }
  return findings;
}

}  // namespace

const std::vector<AccuracyStudy>& accuracy_studies() {
  static const std::vector<AccuracyStudy> studies{{"Regressions", regressions, 240, 0.95},
                                                  {"RegularisedRegressions", regularised_regressions, 40, 1.0},
                                                  {"MarkovParameters", markov_parameters, 60, 1.0},
                                                  {"Realisations", realisations, 60, 1.0},
                                                  {"PredictorSubspaces", predictor_subspaces, 20, 1.0},
                                                  {"Simulations", simulations, 60, 1.0},
                                                  {"KalmanFilters", kalman_filters, 60, 1.0},
                                                  {"Likelihoods", likelihoods, 20, 1.0},
                                                  {"Identifications", identifications, 24, 1.0}};
  return studies;
}

}  // namespace tokid::testing
