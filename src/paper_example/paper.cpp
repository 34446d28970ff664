// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/paper.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/nan.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"
#include "tokid/markov.hpp"
#include "tokid/observer.hpp"

namespace tokid {

namespace {

constexpr Index states = 4, lags = 2, reference_step = 0, block_rows = 3;

// Appendix B as printed. The paper counts steps from 1. Its steps 35, 36, 37 are steps 34, 35, 36 here.
constexpr Index first_printed = 34;
constexpr const char* matrix_equation[] = {"(80)", "(79)", "(81)"};
const Matrix& printed_matrix(Index i) {
  static const Matrix matrices[] = {Matrix{{-1.7924, 0.4678, 0.1630, 0.5778},
                                           {-0.7301, -0.4380, -2.8865, -0.1330},
                                           {1.1874, -0.1662, 0.5671, -0.2986},
                                           {-5.7243, 1.8475, 2.1805, 2.0524}},
                                    Matrix{{-2.0405, 0.3357, 0.0016, 0.5965},
                                           {-1.7735, -0.7681, -3.2887, -0.0289},
                                           {1.7902, -0.0270, 0.8290, -0.3852},
                                           {-6.9208, 1.4773, 1.0572, 2.1980}},
                                    Matrix{{-2.4701, 0.1432, -0.2323, 0.6315},
                                           {-2.3403, -0.8353, -3.3551, 0.0362},
                                           {2.0767, 0.0773, 0.8335, -0.4165},
                                           {-8.8651, 0.6963, -0.2452, 2.3719}}};
  return matrices[i];
}
constexpr std::complex<double> printed_eigenvalues[3][4] = {
    {0.43716, -0.048167, {-2.1173e-14, 7.4549e-14}, {-2.1173e-14, -7.4549e-14}},
    {0.31545, -0.097074, 1.2252e-13, 1.1878e-15},
    {-0.14861, 0.048661, 4.0371e-12, -5.5501e-15}};
constexpr const char* product_equation[] = {"(83)", "(82)"};
const Matrix& printed_product(Index i) {
  static const Matrix products[] = {1e-13 * Matrix{{-0.0844, -0.1443, 0.0888, -0.0711},
                                                   {0.4660, -0.2783, 0.4528, -0.2652},
                                                   {-0.2265, 0.1987, -0.2076, 0.1610},
                                                   {-0.6217, -0.4086, 0.1243, -0.1332}},
                                    1e-12 * Matrix{{-0.0959, 0.0070, -0.0326, 0.0238},
                                                   {-0.1192, 0.0035, -0.0187, 0.0235},
                                                   {-0.0564, 0.0003, -0.0307, 0.0123},
                                                   {0.1137, 0.0075, 0.0551, -0.0187}}};
  return products[i];
}
constexpr double rounding = 1e-11;        // tolerance for numbers that are zero up to rounding errors
constexpr double entry_tolerance = 1e-4;  // of the entries of (79)-(81)

void check(const PaperOptions& o) {
  const auto at_least = [](const char* name, Index found, Index needed) {
    if (found < needed)
      throw std::invalid_argument(fmt::format("{}: {} found, at least {} needed", name, found, needed));
  };
  at_least("steps", o.steps, 50);
  at_least("experiments of case 1", o.minimum, minimum_experiments(2, 2, lags));
  at_least("experiments of case 2", o.more, o.minimum);
  at_least("free responses", o.free_responses, states);
  at_least("band of the Markov parameters", o.markov_band, lags + 1);
}

// Eigenvalues in decreasing modulus, conjugate pairs with the positive imaginary part first.
std::vector<std::complex<double>> sorted_eigenvalues(const Matrix& a) {
  const Eigen::VectorXcd values = linalg::eigenvalues(a);
  std::vector<std::complex<double>> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end(), [](auto x, auto y) {
    return std::make_pair(-std::abs(x), -x.imag()) < std::make_pair(-std::abs(y), -y.imag());
  });
  return sorted;
}

// Inputs that no experiment contains: two tones, one at 3 rad/s and one at 7 rad/s.
Matrix test_inputs(const Model& system, Index steps) {
  Matrix u(steps, system.inputs);
  for (Index k = 0; k < steps; ++k) {
    const double t = double(k) * system.dt;
    u.row(k) << std::sin(3 * t), std::cos(7 * t);
  }
  return u;
}

Ensemble single(const Matrix& u, const Model& system) {
  Ensemble e(1, u.rows(), system.inputs, system.outputs, system.dt);
  for (Index k = 0; k < u.rows(); ++k) e.input(k) = u.row(k);
  return e;
}

// Computes figures 2 to 5 for one case.
PaperCase paper_case(const Paper& paper, Index count, const PaperOptions& options) {
  const Ensemble data =
      experiments(paper.system, {.experiments = count, .seed = options.seed, .free_responses = options.free_responses});
  IdentifyOptions identify_options;
  identify_options.states = states;
  identify_options.lags = lags;
  identify_options.execution = options.execution;
  Identification identification = identify(data, identify_options);
  PaperCase result;
  result.experiments = count;
  result.condition_max = identification.condition_max;
  result.model = std::move(identification.model);

  GtvArxOptions arx_options;
  arx_options.lags = {lags};
  arx_options.execution = options.execution;
  const Markov parameters = markov(gtv_arx(data, arx_options), options.markov_band, options.execution);
  const auto largest_error = [&](Index k, Index from, Index to) {
    double largest = nan;
    for (Index i = k - from; i >= std::max<Index>(0, k - to); --i)
      largest = std::fmax(largest, (parameters.h(k, i) - pulse_response(paper.system, k, i)).norm());
    return largest;
  };
  result.direct_error = result.recursive_error = Vector::Constant(options.steps, nan);
  for (Index k = 0; k < options.steps; ++k) {
    result.direct_error(k) = largest_error(k, 1, lags);
    result.recursive_error(k) = largest_error(k, lags + 1, options.markov_band);
  }

  const Ensemble test = single(paper.test_inputs, paper.system);
  const Ensemble truth = simulate(paper.system, test), computed = simulate(result.model, test);
  result.output_error.resize(options.steps, paper.system.outputs);
  for (Index k = 0; k < options.steps; ++k) result.output_error.row(k) = computed.output(k) - truth.output(k);
  return result;
}

// Computes figures 1, 6 and 7 for case 1, in the reference frame.
void show_observer(Paper& paper) {
  const FramedModel& framed = paper.framed;
  const Index last = framed.end - 1;  // the last state in the frame
  paper.open_error = Matrix::Zero(states, last - framed.begin + 1);
  paper.open_error.col(0).setConstant(0.5);  // of norm 1
  paper.closed_error = paper.open_error;
  for (Index k = framed.begin; k < last; ++k) {
    const Index j = k - framed.begin;
    const Matrix a = framed.model.at(k).A(), closed = framed.model.at(k).closed_loop();
    paper.open.push_back(sorted_eigenvalues(a));
    paper.closed.push_back(sorted_eigenvalues(closed));
    paper.open_error.col(j + 1) = a * paper.open_error.col(j);
    paper.closed_error.col(j + 1) = closed * paper.closed_error.col(j);
  }
  const std::vector<double> products = deadbeat_products(framed.model, lags);
  const auto begin = products.begin() + (framed.begin - framed.model.k_begin);
  paper.products.assign(begin, begin + (last - framed.begin - lags + 1));
}

// T with T·printed = computed·T for all of (79)-(81): the null vector of the stacked matrices printedᵀ ⊗ I - I ⊗
// computed. The frame of the paper is known only up to this similarity, because the paper does not print its free
// responses.
Matrix similarity_to_print(Paper& paper) {
  constexpr Index n = states;
  Matrix equations = Matrix::Zero(3 * n * n, n * n);
  for (Index i = 0; i < 3; ++i) {
    const Matrix computed = paper.framed.model.at(first_printed + i).closed_loop();
    for (Index c = 0; c < n; ++c)
      for (Index b = 0; b < n; ++b) {
        auto block = equations.block(n * n * i + n * c, n * b, n, n);
        block.diagonal().array() += printed_matrix(i)(b, c);
        if (b == c) block -= computed;
      }
  }
  const linalg::Svd d = linalg::svd(equations);
  paper.similarity = d.s(n * n - 1) / d.s(n * n - 2);
  return Eigen::Map<const Matrix>(Vector(d.v.col(n * n - 1)).data(), n, n);
}

double half_unit_of_fifth_digit(double value) {
  return 0.5 * std::pow(10.0, std::floor(std::log10(std::abs(value))) - 4) * (1 + 1e-6);
}

// Compares every number of Appendix B.
void compare_with_print(Paper& paper) {
  const auto add = [&](const char* equation, std::string quantity, std::complex<double> printed,
                       std::complex<double> computed, double tolerance) {
    paper.printed.push_back({equation, std::move(quantity), printed, computed, tolerance});
  };
  const auto add_matrix = [&](const char* equation, const char* name, const Matrix& printed, const Matrix& computed,
                              double tolerance) {
    for (Index a = 0; a < printed.rows(); ++a)
      for (Index b = 0; b < printed.cols(); ++b)
        add(equation, fmt::format("{}[{},{}]", name, a + 1, b + 1), printed(a, b), computed(a, b), tolerance);
  };

  // The time-invariant example (73)-(75), as a model with constant matrices.
  Model constant;
  constant.inputs = constant.outputs = 1;
  constant.step.assign(
      3, Step(Matrix{{1, 0}, {1, 2}}, Matrix::Zero(2, 1), Matrix{{0, 1}}, Matrix::Zero(1, 1), Matrix::Zero(2, 1)));
  constant.at(1).G() = deadbeat_gain(constant).G[1];
  add_matrix("(74)", "G", Matrix{{-1.0}, {-3.0}}, constant.step[1].G(), rounding);
  add_matrix("(75)", "A+GC", Matrix{{1, -1}, {1, -1}}, constant.at(1).closed_loop(), rounding);

  const Matrix t = similarity_to_print(paper), t_inverse = linalg::solve(t, Matrix::Identity(t.rows(), t.cols()));
  const auto closed = [&](Index k) -> Matrix { return t_inverse * paper.framed.model.at(k).closed_loop() * t; };
  for (Index i = 0; i < 3; ++i) {
    const Index k = first_printed + i;
    const std::string name = fmt::format("Ā{}", k + 1);
    add_matrix(matrix_equation[i], name.c_str(), printed_matrix(i), closed(k), entry_tolerance);
    const auto& computed = paper.closed[size_t(k - paper.framed.begin)];
    for (size_t j = 0; j < 4; ++j) {
      const std::complex<double> value = printed_eigenvalues[i][j];
      // A rounding error of the matrix can change its double eigenvalue zero by the square root of the error.
      add(matrix_equation[i], fmt::format("λ{}({})", j + 1, name), value, computed[j],
          j < 2 ? half_unit_of_fifth_digit(value.real()) : std::sqrt(rounding));
    }
  }
  for (Index i = 0; i < 2; ++i) {
    const Index k = first_printed + i;
    add_matrix(product_equation[i], fmt::format("(Ā{}Ā{})", k + 2, k + 1).c_str(), printed_product(i),
               closed(k + 1) * closed(k), rounding);
  }
}

}  // namespace

Paper paper_example(const PaperOptions& options) {
  check(options);
  Paper paper;
  paper.lags = lags;
  paper.system = oscillator(options.steps);
  paper.test_inputs = test_inputs(paper.system, options.steps);
  paper.minimum = paper_case(paper, options.minimum, options);
  paper.more = paper_case(paper, options.more, options);
  paper.framed = reference_frame(paper.minimum.model, reference_step, block_rows);
  if (paper.framed.begin > 0 || paper.framed.end <= first_printed + 3)
    throw std::runtime_error(fmt::format("the reference frame exists only for steps {} to {}, steps 0 to {} needed",
                                         paper.framed.begin, paper.framed.end - 1, first_printed + 3));
  show_observer(paper);
  compare_with_print(paper);
  return paper;
}

}  // namespace tokid
