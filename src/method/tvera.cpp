// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/tvera.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>

#include "linalg/lane_regression.hpp"
#include "linalg/lane_svd.hpp"

namespace tokid {

namespace {

// Singular values below this share of the largest one are rounding errors, whatever the estimated error is.
constexpr double negligible = 8 * std::numeric_limits<double>::epsilon();
// Singular values above this share of the largest one are not arithmetic errors, whatever the estimated error is.
constexpr double arithmetic = 1e-9;

// The sizes of the channels from the options, or 1.
struct Units {
  Units(const Markov& markov, const TveraOptions& options)
      : output(options.output_size.size() > 0 ? options.output_size : Vector(Vector::Ones(markov.outputs))),
        input(options.input_size.size() > 0 ? options.input_size : Vector(Vector::Ones(markov.inputs))) {}
  Vector output, input;
};

// As parallel_for(), but every piece consists of complete groups of `size` steps. Thus all lanes are used for any
// number of threads.
void in_groups(Index begin, Index end, Index size, const Execution& execution,
               const std::function<void(Index, Index)>& body) {
  parallel_for(0, (end - begin + size - 1) / size, execution,
               [&](Index from, Index to) { body(begin + from * size, std::min(end, begin + to * size)); });
}

// Forms H_k of every step and computes its left singular vectors. H_k, A_k, B_k and C_k are those of the companion
// paper on TVERA; the paper itself does not number them.
class Hankel {
 public:
  Hankel(const Markov& markov, const FreeResponse& free, const TveraOptions& options, const Units& units)
      : markov_(markov), free_(free), options_(options), units_(units) {}

  // Factorises the steps begin … end-1. Up to `lanes` successive matrices are factorised together if they have the same
  // shape, or if zero columns can make their shapes equal. Zero columns change neither the singular values nor the left
  // vectors. Unused lanes repeat the last matrix.
  void factorise(Index begin, Index end, HankelFactors& factors) {
    const auto result = [&](Index k) -> HankelFactor& { return factors.step[size_t(k - factors.k_begin)]; };
    const Index lanes = linalg::LaneSvd::lanes();
    for (Index k = begin; k < end;) {
      Shape shape = shape_of(k);
      Index alike = 1;
      while (alike < lanes && k + alike < end && shape.extends_to(shape_of(k + alike))) shape = shape_of(k + alike++);
      if (shape.rows == 0 || shape.cols == 0 || shape.free > 0 || shape.rows > linalg::LaneSvd::most_rows()) {
        alone(k, shape_of(k), result(k));
        ++k;
        continue;
      }
      if (!batch_ || shape != batch_shape_) batch_.emplace(shape.rows, shape.cols), batch_shape_ = shape;
      for (Index l = 0; l < lanes; ++l) {
        const Index step = k + std::min(l, alike - 1);
        const Shape own = shape_of(step);
        form(step, own, result(step), [&](Index i, Index j) -> double& { return batch_->entry(l, i, j); });
        for (Index j = own.cols; j < shape.cols; ++j)
          for (Index i = 0; i < shape.rows; ++i) batch_->entry(l, i, j) = 0.0;
      }
      batch_->run();
      for (Index l = 0; l < alike; ++l, ++k) {
        HankelFactor& factor = result(k);
        if (!batch_->found(l)) {
          alone(k, shape_of(k), factor);
          continue;
        }
        batch_->take(l, factor.u, factor.singular_values);
        factor.scale = std::max(factor.scale, factor.singular_values(0));
      }
    }
  }

 private:
  struct Shape {
    Index rows, cols, free;  // rows; columns of Markov parameters; columns of free responses
    bool operator==(const Shape&) const = default;
    // Can a matrix of this shape be extended by zero columns to the other shape, with the same number of singular
    // values?
    bool extends_to(const Shape& other) const {
      return rows == other.rows && free == other.free && (cols == other.cols || (rows <= cols && cols < other.cols));
    }
  };

  Shape shape_of(Index k) const {
    const Index rows = std::min(options_.rows, markov_.steps() - k),
                cols = std::min(options_.cols, k - markov_.i_begin);
    return {rows * markov_.outputs, cols * markov_.inputs, k + rows <= free_.steps ? free_.experiments : 0};
  }

  // Fills the columns of Markov parameters, and computes the scale and the expected error.
  template <class Entry>
  void form(Index k, const Shape& shape, HankelFactor& factor, Entry&& entry) const {
    const Index m = markov_.outputs, r = markov_.inputs;
    double variance = 0.0, square = 0.0, feedthrough = 0.0;
    for (Index i = 0; i < m; ++i)
      for (Index j = 0; j < r; ++j) {
        const double unit = units_.input(j) / units_.output(i), unit_square = unit * unit;
        for (Index a = 0; a * m < shape.rows; ++a) {
          const auto row = markov_.system(k + a);
          const auto noise = markov_.system_noise(k + a);
          for (Index b = 0; b * r < shape.cols; ++b) {  // h_{k+a,k-1-b}
            const Index column = (a + b) * r + j;
            const double h = row(i, column) * unit;
            entry(a * m + i, b * r + j) = h;
            square += h * h;
            variance += noise(i, column) * unit_square;
          }
        }
        const double d = markov_.D(k)(i, j) * unit;
        feedthrough += d * d;
      }
    factor.scale = std::sqrt(feedthrough);
    factor.error = std::hypot(std::sqrt(variance), negligible * std::sqrt(square));
  }

  void alone(Index k, const Shape& shape, HankelFactor& factor) const {
    Matrix h(shape.rows, shape.cols + shape.free);
    form(k, shape, factor, [&h](Index i, Index j) -> double& { return h(i, j); });
    if (shape.free > 0) {
      const Index m = markov_.outputs;
      auto columns = h.rightCols(shape.free);
      columns = free_.y.middleCols(k * m, shape.rows).transpose();
      columns = units_.output.cwiseInverse().replicate(shape.rows / m, 1).asDiagonal() * columns;
      // Free responses can be much larger or smaller than Markov parameters. Therefore both parts are scaled to the
      // same norm.
      const double forced = h.leftCols(shape.cols).norm(), own = columns.norm();
      if (forced > 0 && own > 0) columns *= forced / own;
      factor.error = std::hypot(factor.error, negligible * columns.norm());
    }
    linalg::Svd d = linalg::svd(h);
    factor.u = std::move(d.u);
    factor.singular_values = std::move(d.s);
    if (factor.singular_values.size() > 0) factor.scale = std::max(factor.scale, factor.singular_values(0));
  }

  const Markov& markov_;
  const FreeResponse& free_;
  const TveraOptions& options_;
  const Units& units_;
  std::optional<linalg::LaneSvd> batch_;
  Shape batch_shape_{};
};

// n_k of step k: the number of singular values of H_k that are not errors.
Index order_of(const HankelFactor& factor, const TveraOptions& options) {
  const Vector& sigma = factor.singular_values;
  // The estimated error may be far too large if it accumulates over many steps. Singular values above the arithmetic
  // error count as nonzero, whatever the estimate is.
  const double threshold = std::min(options.noise_factor * factor.error, arithmetic * factor.scale);
  const Index n = (sigma.array() > threshold).count();
  return options.states > 0 ? std::min(n, options.states) : n;
}

// Computes A_k, B_k, C_k, D_k, G_k from O_k and O_{k+1}, where O = U Σ^{1/2} has n columns.
class Realisation {
 public:
  // `factors` and `states` cover the steps of run() and the step after them.
  Realisation(const Markov& markov, const HankelFactors& factors, const std::vector<Index>& states, const Units& units,
              Model& model)
      : markov_(markov),
        factors_(factors),
        states_(states),
        units_(units),
        model_(model),
        first_(factors.k_begin - model.k_begin) {}

  // Computes the entries begin … end-1 of the model.
  void run(Index begin, Index end) {
    for (Index s = begin; s < end; ++s) B_C_D_G(s);
    const Index lanes = linalg::LaneRegression::lanes();
    for (Index s = begin; s < end;) {
      const Shape shape = shape_of(s);
      Index alike = 1;
      while (alike < lanes && s + alike < end && shape_of(s + alike) == shape) ++alike;
      if (shape.left > 0 && shape.right > 0 && shape.left <= shape.rows &&
          shape.left + shape.right <= linalg::LaneRegression::most_columns()) {
        transitions(s, alike, shape);
        s += alike;
      } else {
        transition(s++, shape);
      }
    }
  }

 private:
  // Shape of the equations O_{k+1}↑ A_k = O_k↓: rows, and columns of the left and of the right matrix. ↑ is without the
  // last block row, ↓ without the first.
  struct Shape {
    Index rows, left, right;
    bool operator==(const Shape&) const = default;
  };

  Index states(Index s) const { return states_[size_t(s - first_)]; }
  const HankelFactor& factor(Index s) const { return factors_.step[size_t(s - first_)]; }
  double root(Index s, Index i) const { return std::sqrt(factor(s).singular_values(i)); }

  Shape shape_of(Index s) const { return {factor(s).u.rows() - markov_.outputs, states(s + 1), states(s)}; }

  // [O_{k+1}↑ O_k↓]
  template <class Target>
  void equations(Index s, const Shape& shape, Target&& target) const {
    for (Index i = 0; i < shape.left; ++i) target.col(i) = factor(s + 1).u.col(i).head(shape.rows) * root(s + 1, i);
    for (Index i = 0; i < shape.right; ++i)
      target.col(shape.left + i) = factor(s).u.col(i).tail(shape.rows) * root(s, i);
  }

  // A_k of one step by shift: (O_{k+1}↑)⁺ O_k↓
  void transition(Index s, const Shape& shape) {
    Matrix both(shape.rows, shape.left + shape.right);
    equations(s, shape, both);
    model_.step[size_t(s)].A() =
        linalg::minimum_norm(both.leftCols(shape.left), both.rightCols(shape.right), negligible).x;
  }

  // A_k of `count` steps, each in a lane; unused lanes repeat the last step.
  void transitions(Index s, Index count, const Shape& shape) {
    const Index cols = shape.left + shape.right, lanes = linalg::LaneRegression::lanes();
    if (!batch_ || shape != batch_shape_) batch_.emplace(shape.rows, shape.left, shape.right), batch_shape_ = shape;
    equations_.resize(shape.rows, lanes * cols);
    for (Index l = 0; l < lanes; ++l)
      equations(s + std::min(l, count - 1), shape, equations_.middleCols(l * cols, cols));
    batch_->run(equations_.data(), shape.rows, shape.rows * cols);
    for (Index l = 0; l < count; ++l) {
      if (!(batch_->condition(l) < linalg::certain_rank)) {
        transition(s + l, shape);
        continue;
      }
      Step::Writable a = model_.step[size_t(s + l)].A();
      for (Index j = 0; j < shape.right; ++j)
        for (Index i = 0; i < shape.left; ++i) a(i, j) = batch_->x(l, i, j);
    }
  }

  // C_k is the first block row of O_k. With O⁺ = Σ^{-1/2} Uᵀ, B_k = O_{k+1}⁺ [h_{k+1,k}; …], and G_k = O_{k+1}⁺ P_{k+1}
  // from the stack P_{k+1} = [h°_{k+1,k}; …]                                                  (37), (38), (40)
  void B_C_D_G(Index s) {
    const Index m = markov_.outputs, r = markov_.inputs, k = model_.k_begin + s, n = states(s), next = states(s + 1);
    Step& step = model_.step[size_t(s)];
    step = Step(n, next, r, m);
    step.set_singular_values(factor(s).singular_values);
    step.D() = markov_.D(k);
    Step::Writable c = step.C();
    for (Index i = 0; i < n; ++i) c.col(i) = units_.output.cwiseProduct(factor(s).u.col(i).head(m)) * root(s, i);
    Step::Writable b = step.B(), g = step.G();
    if (next == 0) return;
    const Matrix& u = factor(s + 1).u;
    responses_.resize(u.rows(), r + m);
    for (Index a = 0; a * m < u.rows(); ++a) {
      responses_.block(a * m, 0, m, r) = markov_.h(k + 1 + a, k);
      responses_.block(a * m, r, m, m) = markov_.h_gain(k + 1 + a, k);
      for (Index i = 0; i < m; ++i) responses_.row(a * m + i) /= units_.output(i);
    }
    for (Index i = 0; i < next; ++i) {
      const double scale = 1 / root(s + 1, i);
      for (Index j = 0; j < r; ++j) b(i, j) = scale * u.col(i).dot(responses_.col(j));
      for (Index j = 0; j < m; ++j) g(i, j) = scale * u.col(i).dot(responses_.col(r + j));
    }
  }

  const Markov& markov_;
  const HankelFactors& factors_;
  const std::vector<Index>& states_;  // n_k of the factors
  const Units& units_;
  Model& model_;
  Index first_;  // entry of the model that belongs to the first factor
  std::optional<linalg::LaneRegression> batch_;
  Shape batch_shape_{};
  Matrix equations_, responses_;
};

void check_sizes(const Markov& markov, const TveraOptions& options) {
  const auto needs = [](const char* name, const Vector& sizes, Index channels) {
    if (sizes.size() > 0 && (sizes.size() != channels || !(sizes.array() > 0).all()))
      throw std::invalid_argument(
          fmt::format("{}: {} values found, {} positive values needed", name, sizes.size(), channels));
  };
  needs("output_size", options.output_size, markov.outputs);
  needs("input_size", options.input_size, markov.inputs);
}

void check(const Markov& markov, const FreeResponse& free, const TveraOptions& options) {
  if (options.rows < 1 || options.cols < 1 || options.states < 0)
    throw std::invalid_argument(
        fmt::format("tvera: {} block rows, {} block columns and {} states found, at least 1, 1 and 0 needed",
                    options.rows, options.cols, options.states));
  check_sizes(markov, options);
  if (options.rows + options.cols - 1 > markov.band && markov.band < markov.steps() - 1)
    throw std::invalid_argument(
        fmt::format("tvera: {} x {} blocks need Markov parameters up to {} steps apart, but the band is {}. Use fewer "
                    "blocks, or a wider band",
                    options.rows, options.cols, options.rows + options.cols - 1, markov.band));
  if (free.experiments > 0 && free.y.cols() != free.steps * markov.outputs)
    throw std::invalid_argument(fmt::format("free_y: {} samples per experiment found, {} steps x {} outputs needed",
                                            free.y.cols(), free.steps, markov.outputs));
}

// The factors may be a caller's own.
void check(const Markov& markov, const HankelFactors& factors) {
  const Index needed = markov.steps() - factors.k_begin, m = markov.outputs;
  if (factors.k_begin < markov.i_begin || Index(factors.step.size()) != needed)
    throw std::invalid_argument(
        fmt::format("factors: {} from step {} on found, {} needed, from step {} or later to step {}",
                    factors.step.size(), factors.k_begin, needed, markov.i_begin, markov.steps() - 1));
  if (factors.rows > markov.band && markov.band < markov.steps() - 1)
    throw std::invalid_argument(
        fmt::format("factors: {} block rows found, at most {} needed, the band of the Markov parameters", factors.rows,
                    markov.band));
  for (Index k = factors.k_begin; k < markov.steps(); ++k) {
    const HankelFactor& factor = factors.step[size_t(k - factors.k_begin)];
    const Index rows = std::min(factors.rows, markov.steps() - k) * m, values = factor.singular_values.size();
    if (factor.u.rows() != rows || factor.u.cols() != values)
      throw std::invalid_argument(fmt::format("factors: u of {} x {} found at step {}, {} x {} needed", factor.u.rows(),
                                              factor.u.cols(), k, rows, values));
  }
}

HankelFactors factors_of(const Markov& markov, const FreeResponse& free, const TveraOptions& options,
                         const Units& units, Index begin, Index end) {
  HankelFactors factors{options.rows, options.cols, begin, std::vector<HankelFactor>(size_t(end - begin))};
  in_groups(begin, end, linalg::LaneSvd::lanes(), options.execution,
            [&](Index from, Index to) { Hankel(markov, free, options, units).factorise(from, to, factors); });
  return factors;
}

// A model of the steps from k_begin on with empty entries.
Model unwritten(const Markov& markov, Index k_begin) {
  Model model;
  model.inputs = markov.inputs;
  model.outputs = markov.outputs;
  model.k_begin = k_begin;
  model.method = "tvera";
  const size_t steps = size_t(markov.steps() - k_begin);
  model.step.resize(steps);
  return model;
}

// Writes the entries begin … end-1 of the model.
void write(const Markov& markov, const HankelFactors& factors, const TveraOptions& options, const Units& units,
           Index begin, Index end, Model& model) {
  std::vector<Index> states;
  for (const HankelFactor& factor : factors.step) states.push_back(order_of(factor, options));
  if (factors.k_begin + Index(factors.step.size()) == markov.steps()) states.push_back(0);  // x_T affects no output
  in_groups(begin, end, linalg::LaneRegression::lanes(), options.execution,
            [&](Index from, Index to) { Realisation(markov, factors, states, units, model).run(from, to); });
}

}  // namespace

HankelFactors hankel_factors(const Markov& markov, const FreeResponse& free, const TveraOptions& options) {
  check(markov, free, options);
  return factors_of(markov, complete(free), options, Units(markov, options), markov.i_begin, markov.steps());
}

Model realise(const Markov& markov, const HankelFactors& factors, const TveraOptions& options) {
  check_sizes(markov, options);
  check(markov, factors);
  Model model = unwritten(markov, factors.k_begin);
  write(markov, factors, options, Units(markov, options), 0, model.steps(), model);
  return model;
}

Model tvera(const Markov& markov, const FreeResponse& free, const TveraOptions& options) {
  // The number of steps whose factors are in memory at once. The factors of all steps would take more memory than the
  // model.
  constexpr Index batch = 4096;
  check(markov, free, options);
  const FreeResponse complete_free = complete(free);
  const Units units(markov, options);
  Model model = unwritten(markov, markov.i_begin);
  TveraOptions part = options;
  for (Index begin = 0, steps = model.steps(); begin < steps; begin += batch) {
    const Index end = std::min(begin + batch, steps), k = model.k_begin + begin;
    part.execution = share(options.execution, double(begin) / double(steps), double(end) / double(steps));
    const HankelFactors factors =
        factors_of(markov, complete_free, part, units, k, std::min(model.k_begin + end + 1, markov.steps()));
    part.execution.progress = {};
    write(markov, factors, part, units, begin, end, model);
  }
  return model;
}

}  // namespace tokid
