// SPDX-License-Identifier: BSD-3-Clause
#include "model/kalman_step.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "model/filter_step.hpp"
#include "testing.hpp"
#include "textbook.hpp"

namespace tokid::testing {
namespace {

// Singular values between 1/spread and 1: the condition of the covariance rootᵀ·root is spread².
Matrix random_root(Random& random, Index n, double spread) {
  Vector s(n);
  for (double& value : s) value = random.uniform(1 / spread, 1);
  return random.orthogonal(n) * s.asDiagonal() * random.orthogonal(n);
}
Matrix of_root(const Matrix& root) { return root.transpose() * root; }

constexpr std::pair<Index, Index> latent_sizes[] = {{1, 1}, {2, 1}, {3, 4}, {6, 2}, {8, 8}};  // q, m

// Condition of S for roots with singular values of at least 1/4, and H of norm ‖H‖.
double condition_of(const Matrix& h) { return 16 * (1 + h.squaredNorm()); }

// Eigen divides by zero here.
TEST(KalmanStep, NoRowsAreTheRootOfZero) { EXPECT_EQ(kalman::covariance_of(Matrix(0, 60)), Matrix::Zero(60, 60)); }

TEST(KalmanStep, CorrectionIsTheSchurComplement) {
  Random random(1);
  kalman::Workspace work;
  kalman::Correction c;
  for (const auto& [q, m] : latent_sizes)
    for (int trial = 0; trial < 20; ++trial) {
      const Matrix p = of_root(random_root(random, q, 4)), r = of_root(random_root(random, m, 4)),
                   h = random.matrix(m, q);
      kalman::correct(p, h, r, work, c);
      const textbook::GivenOutputs exact = textbook::corrected(p, h, r);
      // K is as exact as a solution with S, of which rounding errors of size·ε become so many times larger.
      const double error = double(q + m) * epsilon * condition_of(h);
      EXPECT_LE((c.gain - exact.gain).norm(), error * (1 + c.gain.norm())) << q << " " << m;
      // Joseph's form does not feel the error of K to first order; its factors are as large as 1 + ‖K‖‖H‖.
      const double factor = 1 + c.gain.norm() * h.norm();
      EXPECT_LE((c.filtered - exact.covariance).norm(),
                double(q + m) * epsilon * factor * factor * (p.norm() + r.norm()))
          << q << " " << m;
      EXPECT_EQ(c.filtered, c.filtered.transpose());
      EXPECT_LE((work.innovation - exact.S).norm(),
                double(q + m) * epsilon * (p.norm() + r.norm()) * (1 + h.squaredNorm()));
      EXPECT_LE((c.whitener * work.innovation * c.whitener.transpose() - Matrix::Identity(m, m)).norm(), error);
      EXPECT_NEAR(c.log_det, exact.log_det, error * double(m));
    }
}

TEST(KalmanStep, PropagatesWhatAMapAndNoiseMakeOfACovariance) {
  Random random(2);
  Matrix fp, found;
  for (const auto& [q, n] : latent_sizes) {
    const Matrix p = of_root(random_root(random, q, 4)), noise = of_root(random_root(random, n, 4)),
                 f = random.matrix(n, q);
    kalman::propagate(p, f, noise, fp, found);
    EXPECT_LE((fp - textbook::product(f, p)).norm(), double(q) * epsilon * f.norm() * p.norm());
    EXPECT_LE((found - textbook::propagated(f, p, noise)).norm(),
              2 * double(q) * epsilon * (f.squaredNorm() * p.norm() + noise.norm()));
    EXPECT_EQ(found, found.transpose());
  }
}

TEST(KalmanStep, MissingOutputsAreRowsThatAreNotThere) {
  Random random(3);
  kalman::Workspace work;
  kalman::Correction c, of_part;
  for (const auto& [q, m] : latent_sizes)
    for (Index first = 0; first < m; ++first) {
      std::vector<Index> there;
      for (Index j = first; j < m; j += 2) there.push_back(j);
      const Matrix p = of_root(random_root(random, q, 4)), noise = of_root(random_root(random, m, 4)),
                   outputs = random.matrix(m, q);
      Matrix h = outputs, r = noise;
      kalman::leave_out_missing(there, h, r);
      kalman::correct(p, h, r, work, c);
      kalman::correct(p, outputs(there, Eigen::all), noise(there, there), work, of_part);
      // The same numbers beside zeros and ones, in sums of another order.
      const double error = double(q + m) * epsilon * condition_of(outputs);
      EXPECT_LE((c.gain(Eigen::all, there) - of_part.gain).norm(), error * (1 + c.gain.norm()));
      EXPECT_LE((c.filtered - of_part.filtered).norm(), error * (1 + c.filtered.norm()));
      EXPECT_NEAR(c.log_det, of_part.log_det, error * double(m));
      kalman::each_missing(there, m, [&](Index j) { EXPECT_EQ(c.gain.col(j).norm(), 0.0) << j; });
    }
  std::vector<Index> missing;
  kalman::each_missing({1, 4}, 6, [&](Index j) { missing.push_back(j); });
  EXPECT_EQ(missing, (std::vector<Index>{0, 2, 3, 5}));
}

// x⁺ = A x - G ε, y = C x + ε: with l = [x; ε] the noise of the outputs moves the state, too.
TEST(KalmanStep, InnovationsThatMoveTheStateAreAPartOfWhatIsUnknown) {
  Random random(4);
  kalman::Workspace work;
  kalman::Correction c;
  Matrix fp, next;
  for (const auto& [n, m] : latent_sizes) {
    const Matrix p = of_root(random_root(random, n, 4)), s = of_root(random_root(random, m, 4)),
                 a = random.matrix(n, n), g = random.matrix(n, m), output = random.matrix(m, n);
    Matrix prior = Matrix::Zero(n + m, n + m), h(m, n + m), f(n, n + m);
    prior.topLeftCorner(n, n) = p;
    prior.bottomRightCorner(m, m) = s;
    h << output, Matrix::Identity(m, m);
    f << a, -g;
    kalman::correct(prior, h, Matrix::Zero(m, m), work, c);
    kalman::propagate(c.filtered, f, Matrix::Zero(n, n), fp, next);
    const textbook::GivenOutputs exact = textbook::next_state(a, output, g, p, s);
    const double error = double(2 * n + 3 * m) * epsilon * condition_of(output) * (1 + f.squaredNorm());
    EXPECT_LE((f * c.gain - exact.gain).norm(), error * (1 + c.gain.norm())) << n << " " << m;
    EXPECT_LE((next - exact.covariance).norm(), error * (p.norm() + s.norm()) * (1 + c.gain.squaredNorm()))
        << n << " " << m;
  }
}

TEST(KalmanStep, RootsGiveTheSame) {
  Random random(5);
  for (const auto& [q, m] : latent_sizes)
    for (const Index next : {q, Index(2)}) {
      const Matrix root = random_root(random, q, 4), noise = random_root(random, m, 4),
                   moved = random.matrix(next, next), h = random.matrix(m, q), f = random.matrix(next, q);
      const textbook::GivenOutputs exact = textbook::corrected(of_root(root), h, of_root(noise));
      const Matrix seen = linalg::stacked(noise, root * h.transpose());
      Matrix rest = linalg::stacked(Matrix::Zero(m, q), root);
      const Matrix gain = kalman::prediction_gain(seen, rest);
      const Matrix new_root = kalman::next_root(rest * f.transpose(), moved);
      // Least squares: errors grow with the condition of the root, and with its square where a residual is left.
      const double error = double(q + m) * epsilon * condition_of(h);
      EXPECT_LE((gain - exact.gain).norm(), error * (1 + gain.norm())) << q << " " << m;
      EXPECT_LE((kalman::covariance_of(rest) - exact.covariance).norm(), error * (1 + gain.squaredNorm()));
      EXPECT_LE((kalman::covariance_of(seen) - exact.S).norm(), error * exact.S.norm());
      EXPECT_LE((kalman::covariance_of(new_root) - textbook::propagated(f, exact.covariance, of_root(moved))).norm(),
                error * (1 + gain.squaredNorm()) * (f.squaredNorm() + moved.squaredNorm()));
      EXPECT_LE(new_root.rows(), next);
    }
}

TEST(KalmanStep, SettlesOnTheAlgebraicRiccatiEquation) {
  for (const auto& [n, m] : latent_sizes) {
    const Model model = constant_system({n, m, 1}, 1, 1.0, 6);
    Random random(7);
    const Matrix a = model.step[0].A(), c = model.step[0].C(), q_root = random_root(random, n, 4),
                 r_root = random_root(random, m, 4), q = of_root(q_root), r = of_root(r_root);
    kalman::Workspace work;
    kalman::Correction correction;
    Matrix p = Matrix::Zero(n, n), root = Matrix::Zero(0, n), fp, next;
    for (int k = 0; k < 300; ++k) {
      kalman::correct(p, c, r, work, correction);
      kalman::propagate(correction.filtered, a, q, fp, next);
      p.swap(next);
      Matrix rest = linalg::stacked(Matrix::Zero(m, n), root);
      kalman::prediction_gain(linalg::stacked(r_root, root * c.transpose()), rest);
      root = kalman::next_root(rest * a.transpose(), q_root);
    }
    for (const Matrix& steady : {p, kalman::covariance_of(root)}) {
      const Matrix s = c * steady * c.transpose() + r, g = a * steady * c.transpose();
      const Matrix image = a * steady * a.transpose() - g * s.inverse() * g.transpose() + q;
      // The recursion contracts: what is left are the errors of one step, as above.
      EXPECT_LE((image - steady).norm(), 10 * double(n + m) * epsilon * condition_of(c) * steady.norm())
          << n << " " << m;
    }
  }
}

// Why there are two forms. Where outputs are nearly exact and the state was not known, covariances lose the digits that
// roots keep.
TEST(KalmanStep, RootsKeepTheDigitsThatCovariancesLose) {
  const Index n = 6, m = 2, steps = 6;
  Model model = random_system({n, m, 1}, steps, 1.0, 8);
  for (Step& step : model.step) {
    step.set_Q(Matrix::Zero(n, n));
    step.set_R(1e-10 * Matrix::Identity(m, m));
  }
  model.x0_cov = 1e6 * Matrix::Identity(n, n);
  const std::vector<Matrix> exact = textbook::covariances(model);
  Matrix root = 1e3 * Matrix::Identity(n, n), p = model.x0_cov, fp, next;
  kalman::Workspace work;
  kalman::Correction c;
  double of_roots = 0.0, of_covariances = 0.0;  // errors of P as shares of it
  for (size_t s = 0; s < size_t(steps); ++s) {
    const Step& step = model.step[s];
    const Matrix noise = 1e-5 * Matrix::Identity(m, m);
    Matrix rest = linalg::stacked(Matrix::Zero(m, n), root);
    kalman::prediction_gain(linalg::stacked(noise, root * step.C().transpose()), rest);
    root = kalman::next_root(rest * step.A().transpose(), Matrix::Zero(0, n));
    kalman::correct(p, step.C(), step.R(), work, c);
    kalman::propagate(c.filtered, step.A(), step.Q(), fp, next);
    p.swap(next);
    const double size = exact[s + 1].norm();
    of_roots = std::max(of_roots, (kalman::covariance_of(root) - exact[s + 1]).norm() / size);
    of_covariances = std::max(of_covariances, (p - exact[s + 1]).norm() / size);
  }
  // P falls by 16 orders of magnitude, its root by eight: errors of 1e-8 were found, and of 0.5 to 3 for covariances.
  EXPECT_LE(of_roots, 1e-6);
  EXPECT_GE(of_covariances, 100 * of_roots);
}

// Products of two such variances are subnormal, zero or infinite.
TEST(NearlyEqual, CountsAnyDifferenceOutsideTheRangeOfProducts) {
  const auto covariance = [](double variance) {
    Matrix p(2, 2);
    p << variance, 0.5 * variance, 0.5 * variance, variance;
    return p;
  };
  const auto equal_with = [&](double variance, Index i, Index j, double difference) {
    const Matrix b = covariance(variance);
    Matrix a = b;
    a(i, j) += difference;
    EXPECT_NE(a, b);
    return kalman::nearly_equal(a, b);
  };
  for (const double variance : {1e-150, 1.0, 1e150})
    for (const Index j : {0, 1}) {
      EXPECT_TRUE(kalman::nearly_equal(covariance(variance), covariance(variance)));
      EXPECT_TRUE(equal_with(variance, 0, j, 5e-15 * variance)) << variance;
      EXPECT_FALSE(equal_with(variance, 0, j, 2e-14 * variance)) << variance;
    }
  for (const double variance : {0.0, 1e-160, 1e160})
    for (const Index j : {0, 1}) {
      EXPECT_TRUE(kalman::nearly_equal(covariance(variance), covariance(variance)));
      EXPECT_FALSE(equal_with(variance, 0, j, variance > 0 ? 5e-15 * variance : 1e-300)) << variance;
    }
  // One variance is large and one small, but their product is 1.
  Matrix b(2, 2);
  b << 1e160, 0.0, 0.0, 1e-160;
  Matrix a = b;
  a(1, 0) = 5e-15;
  EXPECT_TRUE(kalman::nearly_equal(a, b));
  a(1, 0) = 2e-14;
  EXPECT_FALSE(kalman::nearly_equal(a, b));
  a(1, 0) = nan;
  EXPECT_FALSE(kalman::nearly_equal(a, b));
}

}  // namespace
}  // namespace tokid::testing
