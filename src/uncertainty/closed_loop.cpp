// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include "tokid/uncertainty.hpp"
#include "uncertainty/interval.hpp"
#include "uncertainty/recursion.hpp"

namespace tokid {

namespace {

using Eigen::VectorXcd;
using uncertainty::Rows;
using uncertainty::StudentT;
using uncertainty::Variance;

struct CommonFrame {
  FramedModel framed;
  Index step = 0, rows = 0;
};

CommonFrame frame_of(const Model& model, const ClosedLoopOptions& options) {
  const Index s = options.reference_step >= 0 ? options.reference_step : model.full_begin();
  const Index rows = options.rows > 0 ? options.rows : estimation_window(model);
  return {reference_frame(model, s, rows), s, rows};
}

// The number of steps k for which both x_k and x_{k+1} are in the frame.
Index count(const CommonFrame& frame) { return frame.framed.end - 1 - frame.framed.begin; }

// Errors of Markov parameters change O_k by dO_k = dH_k · from_inputs, except for a change of coordinates. Outputs give
// the state: x = from_outputs · (O_k x).
struct Factor {
  Matrix observability;  // O_k (rows·m × n)
  Matrix from_outputs;   // (n × rows·m)
  Matrix from_inputs;    // (cols·r × n)
  Index rows = 0, cols = 0;
};

class Factors {
 public:
  Factors(const GtvArx& arx, const Model& model, const TveraOptions& options)
      : model_(model),
        options_(options),
        markov_(markov(arx, options.rows + options.cols - 1, {options.execution.threads, {}})),
        output_size_(options.output_size.size() > 0 ? options.output_size : Vector(Vector::Ones(arx.outputs))),
        input_size_(options.input_size.size() > 0 ? options.input_size : Vector(Vector::Ones(arx.inputs))) {}

  Index first_pulse() const { return markov_.i_begin; }

  // Left inverse of block rows of outputs, in the units of the realisation.
  Matrix left_inverse(const Matrix& o) const {
    const Vector scale = output_size_.cwiseInverse().replicate(o.rows() / output_size_.size(), 1);
    return linalg::pseudo_inverse(scale.asDiagonal() * o) * scale.asDiagonal();
  }

  Factor at(Index k) const {
    Factor f;
    f.rows = std::min(options_.rows, model_.k_end() - k);
    f.cols = std::min(options_.cols, k - markov_.i_begin);
    f.observability = observability(model_, k, f.rows);
    f.from_outputs = left_inverse(f.observability);
    const Index m = markov_.outputs, r = markov_.inputs;
    Matrix h(f.rows * m, f.cols * r);
    for (Index a = 0; a < f.rows; ++a)
      for (Index b = 0; b < f.cols; ++b) h.block(a * m, b * r, m, r) = markov_.h(k + a, k - 1 - b);
    const Vector scale = input_size_.replicate(f.cols, 1);
    f.from_inputs = scale.asDiagonal() * linalg::pseudo_inverse(f.from_outputs * h * scale.asDiagonal());
    return f;
  }

 private:
  const Model& model_;
  const TveraOptions& options_;
  Markov markov_;
  Vector output_size_, input_size_;
};

// dμ = Σ_l tr(gradient_lᵀ dM_l). The gradient of a step is projected on the factor of the covariance of M_l, which
// gives two real matrices (m × rank).
class Gradient {
 public:
  explicit Gradient(const GtvArx& arx) : arx_(arx) {}

  // Adds ℓᵀ dH_k c. The recursion runs from the inputs u_{k-1-b} = c_b, and ℓ weights its outputs from step k on.
  void add_hankel(Index k, Index rows, Index cols, const VectorXcd& l, const VectorXcd& c) {
    const Index first = k - cols, r = arx_.inputs;
    Rows samples = rest(first, k + rows);
    for (Index b = 0; b < cols; ++b) uncertainty::input(arx_, samples, k - 1 - b) = pair(c.segment(b * r, r));
    uncertainty::run(arx_, first, k + rows, samples);
    add(samples, first, k, k + rows, l);
  }

  // Adds ℓᵀ dP_{k+1} c. The recursion runs from the output -c at step k, the start of (34).
  void add_gain(Index k, Index rows, const VectorXcd& l, const VectorXcd& c) {
    Rows samples = rest(k, k + 1 + rows);
    uncertainty::output(arx_, samples, k) = -pair(c);
    uncertainty::run(arx_, k + 1, k + 1 + rows, samples);
    add(samples, k + 1, k + 1, k + 1 + rows, l);
  }

  // Variances of real and imaginary part with their degrees of freedom, and the covariance of the two parts.
  void variances(Variance& real, Variance& imaginary, double& covariance, Index entry) const {
    covariance = 0.0;
    for (const auto& [s, parts] : parts_) {
      const Matrix cov = uncertainty::innovation_cov(arx_, s);
      const Index found = arx_.step[size_t(s)].freedom;
      const double freedom = double(std::max<Index>(1, found));
      const auto gather = [&](const Matrix& part, Variance& variance) {
        double v = (cov * part).cwiseProduct(part).sum();
        if (found == 0 && (part.array() != 0).any()) v = std::numeric_limits<double>::infinity();
        if (v == 0) return;
        variance.sum(entry) += v;
        variance.spread(entry) += v * v / freedom;
      };
      gather(parts.real, real);
      gather(parts.imaginary, imaginary);
      covariance += (cov * parts.real).cwiseProduct(parts.imaginary).sum();
    }
  }

 private:
  struct Parts {
    Matrix real, imaginary;
  };

  static Matrix pair(const VectorXcd& values) {
    Matrix result(2, values.size());
    result << values.real().transpose(), values.imag().transpose();
    return result;
  }

  // Two zero rows, for real and imaginary part, with space for the lags before `first`.
  Rows rest(Index first, Index end) const {
    const Index origin = std::max<Index>(0, first - uncertainty::largest_lag_order(arx_));
    return {arx_, 2, origin, end - origin};
  }

  void add(const Rows& samples, Index first, Index weighed, Index end, const VectorXcd& l) {
    const Index m = arx_.outputs;
    std::vector<Matrix> weights(size_t(end - first), Matrix::Zero(m, 2));
    for (Index k = weighed; k < end; ++k)
      weights[size_t(k - first)] = pair(l.segment((k - weighed) * m, m)).transpose();
    uncertainty::run_backwards(arx_, first, end, weights);
    for (Index s = first; s < end; ++s) {
      const GtvArx::View x = arx_.noise_shape(s);
      Parts& parts = parts_[s];
      if (parts.real.size() == 0) parts.real = parts.imaginary = Matrix::Zero(m, x.cols());
      const Matrix projected = uncertainty::window(arx_, samples, s) * x;
      const auto re = weights[size_t(s - first)].col(0), im = weights[size_t(s - first)].col(1);
      parts.real += re * projected.row(0) - im * projected.row(1);
      parts.imaginary += re * projected.row(1) + im * projected.row(0);
    }
  }

  const GtvArx& arx_;
  std::map<Index, Parts> parts_;
};

// All quantities that determine the eigenvalues of one step.
class ClosedLoop {
 public:
  ClosedLoop(const GtvArx& arx, const Model& model, const Factors& factors, const CommonFrame& frame, Index k)
      : arx_(arx),
        model_(model),
        factors_(factors),
        k_(k),
        s_(frame.step),
        now_(factors.at(k)),
        next_(factors.at(k + 1)),
        reference_(factors.at(frame.step)),
        // The frame may have more block rows than the realisation. The additional block rows affect the eigenvalues
        // only in higher order.
        head_(frame.rows * model.outputs) {
    projection_ = linalg::pseudo_inverse(observability(model, s_, frame.rows));
    from_frame_ = linalg::pseudo_inverse(projection_ * observability(model, k, frame.rows));
    next_to_frame_ = projection_ * observability(model, k + 1, frame.rows);
    loop_ = model.at(k).closed_loop();
  }

  // dμ for Ā'_k = (P O_{k+1}) Ā_k (P O_k)⁻¹, P = O_s⁺, and its eigenvectors ψ Ā'_k = μ ψ, Ā'_k ψ_r = μ ψ_r, ψ ψ_r = 1.
  Gradient gradient(std::complex<double> value, const VectorXcd& right, const VectorXcd& left) const {
    const Index m = model_.outputs;
    const size_t at = model_.index(k_);
    const VectorXcd a = from_frame_ * right;
    const VectorXcd beta = next_to_frame_.transpose() * left;
    const VectorXcd frame_weights = projection_.transpose() * left;  // Pᵀ ψ
    Gradient gradient(arx_);

    // ψ dP z with z = O_{k+1} Ā_k a - μ O_k a, where P z = 0.
    const VectorXcd z =
        observability(model_, k_ + 1, head_ / m) * (loop_ * a) - value * (observability(model_, k_, head_ / m) * a);
    add(gradient, s_, reference_, z, projection_ * frame_weights);

    // A_k = (O_{k+1}↑)⁺ O_k↓
    const Index shared = now_.rows - 1;
    const Matrix inverse = factors_.left_inverse(next_.observability.topRows(shared * m));
    const VectorXcd solved = inverse.transpose() * beta;
    VectorXcd weights = VectorXcd::Zero(std::max(head_, now_.rows * m));
    weights.head(head_) -= value * frame_weights;
    weights.head(m) += model_.step[at].G().transpose() * beta;  // through C_k
    weights.segment(m, shared * m) += solved;
    add(gradient, k_, now_, weights, a);
    add(gradient, k_ + 1, next_, frame_weights, loop_ * a);
    add(gradient, k_ + 1, next_, -solved, model_.step[at].A() * a);

    // G_k = O_{k+1}⁺ P_{k+1}. Without changes of coordinates O_{k+1}⁺ dO_{k+1} = 0, so only dP_{k+1} contributes.
    gradient.add_gain(k_, next_.rows, next_.from_outputs.transpose() * beta, model_.step[at].C() * a);
    return gradient;
  }

 private:
  // ℓᵀ dO_k c = (Πᵀℓ)ᵀ dH_k (from_inputs c), where Π removes changes of coordinates.
  static void add(Gradient& gradient, Index k, const Factor& factor, const VectorXcd& l, const VectorXcd& c) {
    VectorXcd fitted = VectorXcd::Zero(factor.observability.rows());
    const Index common = std::min(fitted.size(), l.size());
    fitted.head(common) = l.head(common);
    fitted -= factor.from_outputs.transpose() * (factor.observability.transpose() * fitted).eval();
    gradient.add_hankel(k, factor.rows, factor.cols, fitted, factor.from_inputs * c);
  }

  const GtvArx& arx_;
  const Model& model_;
  const Factors& factors_;
  Index k_, s_;
  Factor now_, next_, reference_;
  Index head_;  // number of output rows in the frame
  Matrix projection_, from_frame_, next_to_frame_, loop_;
};

void check_model(const GtvArx& arx, const Model& model, const TveraOptions& o) {
  if (arx.inputs != model.inputs || arx.outputs != model.outputs || model.k_begin < arx.k_begin ||
      model.k_end() != arx.steps())
    throw std::invalid_argument(
        fmt::format("model: {} inputs, {} outputs, steps {} to {} found, {} inputs, {} outputs, steps {} to {} "
                    "needed, as in the regressions",
                    model.inputs, model.outputs, model.k_begin, model.k_end() - 1, arx.inputs, arx.outputs, arx.k_begin,
                    arx.steps() - 1));
  if (o.rows < 2 || o.cols < 1)
    throw std::invalid_argument(
        fmt::format("realisation: {} block rows and {} columns found, at least 2 and 1 needed", o.rows, o.cols));
}

}  // namespace

Spectrum closed_loop_spectrum(const Model& model, const ClosedLoopOptions& options) {
  const CommonFrame frame = frame_of(model, options);
  Spectrum result{frame.framed.begin, {}};
  for (Index k = result.begin; k < result.begin + count(frame); ++k)
    result.eigenvalues.push_back(linalg::eigenvalues(frame.framed.model.at(k).closed_loop()));
  return result;
}

SpectrumBounds closed_loop_bounds(const GtvArx& arx, const Model& model, const TveraOptions& realisation,
                                  const ClosedLoopOptions& options) {
  check_model(arx, model, realisation);
  arx.require_noise_shape();
  const StudentT t(options.level);
  const CommonFrame frame = frame_of(model, options);
  const Factors factors(arx, model, realisation);
  SpectrumBounds result;
  result.begin = frame.framed.begin;
  result.step.resize(size_t(count(frame)));
  parallel_for(0, count(frame), options.execution, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) {
      const Index k = result.begin + i;
      const Matrix closed = frame.framed.model.at(k).closed_loop();
      const linalg::Eigensystem d = linalg::eigensystem(closed);
      const ClosedLoop loop(arx, model, factors, frame, k);
      const Index n = d.values.size();
      Variance real(n, 1), imaginary(n, 1);
      SpectrumBounds::Step& step = result.step[size_t(i)];
      step.eigenvalues = d.values;
      step.covariance.resize(n);
      for (Index e = 0; e < n; ++e)
        loop.gradient(d.values(e), d.right.col(e), d.left.row(e).transpose())
            .variances(real, imaginary, step.covariance(e), e);
      step.real = uncertainty::interval(d.values.real(), real, t);
      step.imaginary = uncertainty::interval(d.values.imag(), imaginary, t);
      uncertainty::find_simple(step, closed.norm());
    }
  });
  return result;
}

}  // namespace tokid
