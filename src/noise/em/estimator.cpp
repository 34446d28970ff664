// SPDX-License-Identifier: BSD-3-Clause
#include "noise/em/estimator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "linalg/symmetric.hpp"
#include "tokid/random_walk.hpp"

namespace tokid::em {

namespace {

// If noise is below this share of a signal's mean square, rounding errors of the moments may be larger than the noise.
constexpr double smallest_noise = 1e-12;

Noise pooled(const std::vector<Matrix>& of_phase) {
  Matrix mean = Matrix::Zero(of_phase[0].rows(), of_phase[0].cols());
  for (const Matrix& a : of_phase) mean += a / double(of_phase.size());
  return {{mean}, Vector::Ones(1), std::vector<Index>(of_phase.size(), 0)};
}

Noise separate(std::vector<Matrix> of_phase) {
  const size_t phases = of_phase.size();
  return {std::move(of_phase), Vector::Ones(1), std::vector<Index>(phases, 0)};
}

// The degrees of freedom that a random-walk coefficient uses in this many phases: the sum of 1 / (1 + λ μ) over the
// eigenvalues μ of the second difference.
double freedom_of(Index phases, double smoothing) {
  double sum = 0.0;
  for (Index j = 0; j < phases; ++j)
    sum += 1 / (1 + smoothing * 2 * (1 - std::cos(std::numbers::pi * double(j) / double(phases))));
  return sum;
}

Matrix whitener_of(const Matrix& covariance) {
  Matrix w;
  linalg::inverse_root(covariance, w);
  return w;
}

}  // namespace

bool Parameters::finite() const {
  const auto all = [](const std::vector<Matrix>& list) {
    return std::all_of(list.begin(), list.end(), [](const Matrix& a) { return a.allFinite(); });
  };
  return all(ab) && all(cd) && all(process.shape) && all(measurement.shape) && process.scale.allFinite() &&
         measurement.scale.allFinite() && x0_mean.allFinite() && x0_cov.allFinite();
}

Estimator::Estimator(const Model& start, const kalman::Samples& samples, const EstimatorOptions& options)
    : model_(start),
      options_(options),
      n_(start.states()),
      r_(start.inputs),
      m_(start.outputs),
      steps_(samples.steps),
      phases_(options.period > 0 ? std::min(options.period, samples.steps) : samples.steps),
      pooled_(options.smoothing > 0) {
  // A phase starts with the mean of the matrices of its steps.
  std::vector<Matrix> q(size_t(phases_), Matrix::Zero(n_, n_)), r(size_t(phases_), Matrix::Zero(m_, m_));
  start_.ab.assign(size_t(phases_), Matrix::Zero(n_, n_ + r_));
  start_.cd.assign(size_t(phases_), Matrix::Zero(m_, n_ + r_));
  for (Index t = 0; t < steps_; ++t) {
    const size_t s = size_t(t), g = size_t(t % phases_);
    const Index times = (steps_ - 1 - t % phases_) / phases_ + 1;
    const double share = 1.0 / double(times);
    start_.ab[g] += share * linalg::beside(start.step[s].A(), start.step[s].B());
    start_.cd[g] += share * linalg::beside(start.step[s].C(), start.step[s].D());
    q[g] += share * start.step[s].Q();
    r[g] += share * start.step[s].R();
  }
  start_.process = pooled_ ? pooled(q) : separate(std::move(q));
  start_.measurement = pooled_ ? pooled(r) : separate(std::move(r));
  start_.x0_mean = start.x0_mean.size() > 0 ? start.x0_mean : Vector::Zero(n_);
  start_.x0_cov = start.x0_cov.size() > 0 ? start.x0_cov : Matrix::Zero(n_, n_);
}

Model Estimator::model(const Parameters& p) const {
  Model model = model_;
  for (Index t = 0; t < steps_; ++t) {
    const Index g = t % phases_;
    const size_t s = size_t(t);
    model.step[s].A() = p.ab[size_t(g)].leftCols(n_);
    model.step[s].B() = p.ab[size_t(g)].rightCols(r_);
    model.step[s].C() = p.cd[size_t(g)].leftCols(n_);
    model.step[s].D() = p.cd[size_t(g)].rightCols(r_);
    model.step[s].set_Q(p.process.of(g));
    model.step[s].set_R(p.measurement.of(g));
  }
  model.x0_mean = p.x0_mean;
  model.x0_cov = p.x0_cov;
  return model;
}

namespace {

// A typical value of each of the first `size` diagonal entries: the geometric mean over the steps at which the entry is
// not zero. With this mean, a state that grows by orders of magnitude is not dominated by its last steps.
Vector typical(const std::vector<Matrix>& moments, Index size) {
  Vector logs = Vector::Zero(size), count = logs;
  for (const Matrix& a : moments)
    for (Index i = 0; i < size; ++i)
      if (a(i, i) > 0) logs(i) += std::log(a(i, i)), count(i) += 1;
  return (count.array() > 0).select((logs.array() / count.array().max(1.0)).exp(), 0.0);
}

}  // namespace

void Estimator::set_scales(const kalman::Moments& moments, const kalman::Samples& samples) {
  const auto mean_diagonal = [&](const std::vector<Matrix>& list) {
    Vector sum = Vector::Zero(n_ + r_);
    for (const Matrix& a : list) sum += a.diagonal().head(n_ + r_);
    return sum;
  };
  const double experiments = double(std::max<Index>(1, samples.experiments));
  const auto weight = [&](const std::vector<Matrix>& list) {
    Vector w = typical(list, n_ + r_) * double(steps_) / double(phases_);
    for (double& value : w)
      if (!(value > 0)) value = experiments;  // a signal that is zero may have any weight
    return w;
  };
  process_weight_ = weight(moments.moved);
  measurement_weight_ = weight(moments.measured);
  const double count = std::max(1.0, moments.measured_count.sum());
  process_floor_ = (smallest_noise / count * mean_diagonal(moments.measured).head(n_)).array().max(1e-300);
  measurement_floor_ = (smallest_noise * samples.y_square).array().max(1e-300);
  for (Matrix& q : start_.process.shape) q = linalg::bounded_below(q, process_floor_);
  for (Matrix& r : start_.measurement.shape) r = linalg::bounded_below(r, measurement_floor_);
  // The second moment of the state at a typical step, times the ratio of innovations to outputs.
  const double of_step = double(std::max<Index>(1, (moments.measured_count.array() > 0).count())) / count;
  Matrix state = Matrix::Zero(n_, n_);
  std::vector<Matrix> outputs;
  for (const Matrix& a : moments.measured) {
    state += a.topLeftCorner(n_, n_) / count;
    outputs.emplace_back(a.bottomRightCorner(m_, m_));
  }
  const Vector size = (typical(moments.measured, n_) * of_step).cwiseMax(process_floor_);
  const Vector scale = (size.array() / state.diagonal().array().max(process_floor_.array())).sqrt();
  state = scale.asDiagonal() * state * scale.asDiagonal();
  measurement_reference_ = linalg::bounded_below(options_.innovation_cov, measurement_floor_);
  const Vector output = (typical(outputs, m_) * of_step).cwiseMax(measurement_floor_);
  const double ratio = (measurement_reference_.diagonal().array() / output.array()).mean();
  process_reference_ = linalg::bounded_below(ratio * state, process_floor_);
  const auto per_phase = [&](const Vector& counts) {
    Vector sums = Vector::Zero(phases_);
    for (Index t = 0; t < steps_; ++t) sums(t % phases_) += counts(t);
    return sums;
  };
  moved_ = per_phase(moments.moved_count);
  measured_ = per_phase(moments.measured_count);
  // The number of free coefficients (without the choice of coordinates) relative to the number of output samples, at
  // most 0.5. Each noise gets half of this share, or less of it for n > m states. A change of the size of Q or R then
  // never gains more by the share than it loses in likelihood.
  const Index free = n_ * r_ + m_ * (n_ + (options_.feedthrough ? r_ : 0));
  double used = 0.0;
  for (const auto& [begin, end] : stretches()) used += double(free) * freedom_of(end - begin, options_.smoothing);
  const double share = options_.estimate_matrices ? std::min(0.5, used / std::max(1.0, samples.outputs)) : 0.0;
  measurement_spent_ = share / 2;
  process_spent_ = n_ > 0 ? share / 2 * std::min(1.0, double(m_) / double(n_)) : 0.0;
  if (options_.estimate_x0) {
    const double known = std::max(1.0, moments.x0_count);
    const Vector mean = moments.x0 / known;
    x0_prior_ = linalg::bounded_below(moments.x0_square / known - mean * mean.transpose(), process_floor_);
    start_.x0_mean = mean;
    start_.x0_cov = x0_prior_;
  }
}

namespace {

double variation(const std::vector<Matrix>& theta, const std::vector<Index>& jumps, const Matrix& reference,
                 const Vector& weight) {
  const Matrix w = whitener_of(reference);
  double sum = 0.0;
  for (size_t g = 1; g < theta.size(); ++g)
    if (!std::binary_search(jumps.begin(), jumps.end(), Index(g)))
      sum += (w * (theta[g] - theta[g - 1]) * weight.cwiseSqrt().asDiagonal()).squaredNorm();
  return sum;
}

// Σ_g count_g log det of the noise of phase g
double log_determinants(const Noise& noise, const Vector& counts) {
  Matrix w;
  const double shape = linalg::inverse_root(noise.shape[0], w), size = double(noise.shape[0].rows());
  double sum = 0.0;
  for (size_t g = 0; g < noise.segment.size(); ++g)
    sum += counts(Index(g)) * (shape + size * std::log(noise.scale(noise.segment[g])));
  return sum;
}

}  // namespace

double Estimator::penalty(const Parameters& p) const {
  double sum = 0.0;
  if (options_.smoothing > 0 && phases_ > 1)
    sum += 0.5 * options_.smoothing *
           (variation(p.ab, options_.jumps, process_reference_, process_weight_) +
            variation(p.cd, options_.jumps, measurement_reference_, measurement_weight_));
  if (pooled_)
    sum -= 0.5 * (process_spent_ * log_determinants(p.process, moved_) +
                  measurement_spent_ * log_determinants(p.measurement, measured_));
  if (options_.estimate_x0) {
    Matrix w;
    const double log_det = linalg::inverse_root(p.x0_cov, w);
    sum += 0.5 * double(n_ + 1) * (log_det + (w * x0_prior_ * w.transpose()).trace());
  }
  return sum;
}

std::vector<Matrix> Estimator::phase_roots(const std::vector<Matrix>& moments, const Vector& counts,
                                           Vector& totals) const {
  std::vector<Matrix> sums(moments.begin(), moments.begin() + phases_);
  totals = counts.head(phases_);
  for (Index t = phases_; t < steps_; ++t) {
    sums[size_t(t % phases_)] += moments[size_t(t)];
    totals(t % phases_) += counts(t);
  }
  for (Matrix& sum : sums) sum = linalg::upper_root(sum);
  return sums;
}

// The phases between two jumps: begin and end of each stretch.
std::vector<std::pair<Index, Index>> Estimator::stretches() const {
  std::vector<std::pair<Index, Index>> result;
  Index begin = 0;
  for (const Index jump : options_.jumps) result.emplace_back(begin, jump), begin = jump;
  result.emplace_back(begin, phases_);
  return result;
}

Estimator::Walks Estimator::walks_of(const std::vector<Matrix>& roots, const Noise& noise, Index l,
                                     const Matrix& reference, const Vector& weight) const {
  const Index q = reference.rows();
  const Matrix whitener = whitener_of(reference);
  const linalg::Svd eigen = linalg::svd(whitener * noise.shape[0] * whitener.transpose());
  if (q > 0 && !(eigen.s(q - 1) > std::numeric_limits<double>::epsilon() * eigen.s(0) && std::isfinite(eigen.s(0))))
    throw std::runtime_error("EM has diverged: the covariance of the noise is singular. Start from another model");
  Walks walks{eigen.u.transpose() * whitener, eigen.s, {}, {}};
  walks.stiffness = (options_.smoothing * weight.head(l) * eigen.s.transpose()).cwiseSqrt();
  for (Index g = 0; g < phases_; ++g) {
    const Matrix& root = roots[size_t(g)];
    Matrix& block = walks.rows.emplace_back(l, l + q);
    block.leftCols(l) = root.topLeftCorner(l, l);
    block.rightCols(q).noalias() = root.topRightCorner(l, q) * walks.t.transpose();
    block /= std::sqrt(noise.scale(noise.segment[size_t(g)]));
  }
  return walks;
}

// Only the first `l` of the n + r coefficients are estimated, and the others keep their values.
std::vector<Matrix> Estimator::regress(const std::vector<Matrix>& roots, const std::vector<Matrix>& before,
                                       const Noise& noise, Index l, const Matrix& reference,
                                       const Vector& weight) const {
  const Index q = reference.rows();
  std::vector<Matrix> result(before);
  if (q == 0 || l == 0) return result;
  const auto has_data = [&](size_t g) { return !roots[g].topLeftCorner(l, l).isZero(0.0); };
  if (!pooled_ || phases_ == 1) {
    const std::vector<Matrix> theta = [&] {
      std::vector<Matrix> rows;
      for (const Matrix& root : roots)
        rows.push_back(linalg::beside(root.topLeftCorner(l, l), root.topRightCorner(l, q)));
      return random_walk_regression(rows, l, Vector::Zero(l));
    }();
    for (size_t g = 0; g < theta.size(); ++g)
      if (has_data(g)) result[g].leftCols(l) = theta[g].transpose();
    return result;
  }
  const Walks walks = walks_of(roots, noise, l, reference, weight);
  const Matrix back = linalg::pseudo_inverse(walks.t);
  for (const auto& [begin, end] : stretches()) {
    const std::vector<Matrix> rotated =
        random_walk_regressions({walks.rows.begin() + begin, walks.rows.begin() + end}, walks.stiffness);
    for (Index g = begin; g < end; ++g) result[size_t(g)].leftCols(l) = back * rotated[size_t(g - begin)].transpose();
  }
  return result;
}

Vector Estimator::jump_gains(const kalman::Moments& moments, const Parameters& p) const {
  Vector gains = Vector::Zero(phases_);
  const auto add = [&](const std::vector<Matrix>& sums, const Vector& counts, const Noise& noise, Index l,
                       const Matrix& reference, const Vector& weight) {
    Vector totals;
    const Index q = reference.rows();
    const Walks walks = walks_of(phase_roots(sums, counts, totals), noise, l, reference, weight);
    for (const auto& [begin, end] : stretches())
      for (Index i = 0; i < q; ++i) {
        std::vector<Matrix> own;
        for (Index g = begin; g < end; ++g)
          own.push_back(linalg::beside(walks.rows[size_t(g)].leftCols(l), walks.rows[size_t(g)].col(l + i)));
        gains.segment(begin, end - begin) += tokid::jump_gains(own, walks.stiffness.col(i)) / walks.noise(i);
      }
  };
  add(moments.moved, moments.moved_count, p.process, n_ + r_, process_reference_, process_weight_);
  add(moments.measured, moments.measured_count, p.measurement, options_.feedthrough ? n_ + r_ : n_,
      measurement_reference_, measurement_weight_);
  return gains;
}

void Estimator::update_noise(const std::vector<Matrix>& roots, const Vector& counts,
                             const std::vector<Matrix>& coefficients, const Vector& floor, double spent,
                             Noise& noise) const {
  const Index l = n_ + r_, q = floor.size();
  if (q == 0) return;
  std::vector<Matrix> residual;
  for (size_t g = 0; g < roots.size(); ++g) {
    const Matrix misfit = roots[g].topRightCorner(l, q) - roots[g].topLeftCorner(l, l) * coefficients[g].transpose();
    const Matrix rest = roots[g].bottomRightCorner(q, q);
    residual.emplace_back(misfit.transpose() * misfit + rest.transpose() * rest);
  }
  if (!pooled_) {
    for (size_t g = 0; g < residual.size(); ++g)
      if (counts(Index(g)) > 0) noise.shape[g] = linalg::bounded_below(residual[g] / counts(Index(g)), floor);
    return;
  }
  if (!(counts.sum() > 0)) return;
  Matrix sum = Matrix::Zero(q, q);
  for (size_t g = 0; g < residual.size(); ++g) sum += residual[g] / noise.scale(noise.segment[g]);
  Matrix& shape = noise.shape[0];
  shape = linalg::bounded_below(sum / (counts.sum() * (1 - spent)), floor / noise.scale.minCoeff());
  if (noise.scale.size() == 1) return;
  const Matrix w = whitener_of(shape);
  // The smallest scale that keeps all variances above the floor.
  const double least = linalg::singular_values(w * floor.asDiagonal() * w.transpose())(0);
  Vector squares = Vector::Zero(noise.scale.size()), samples = squares;
  for (size_t g = 0; g < residual.size(); ++g) {
    squares(noise.segment[g]) += (w * residual[g] * w.transpose()).trace();
    samples(noise.segment[g]) += counts(Index(g));
  }
  for (Index i = 0; i < noise.scale.size(); ++i)
    if (samples(i) > 0) noise.scale(i) = std::max(least, squares(i) / (double(q) * samples(i) * (1 - spent)));
}

Parameters Estimator::maximise(const kalman::Moments& moments, const Parameters& p) const {
  Parameters next = p;
  Vector moved, measured;
  const std::vector<Matrix> process = phase_roots(moments.moved, moments.moved_count, moved);
  const std::vector<Matrix> output = phase_roots(moments.measured, moments.measured_count, measured);
  const Index all = n_ + r_, of_outputs = options_.feedthrough ? all : n_;
  if (options_.estimate_matrices) {
    next.ab = regress(process, p.ab, p.process, all, process_reference_, process_weight_);
    next.cd = regress(output, p.cd, p.measurement, of_outputs, measurement_reference_, measurement_weight_);
  }
  update_noise(process, moved, next.ab, process_floor_, process_spent_, next.process);
  update_noise(output, measured, next.cd, measurement_floor_, measurement_spent_, next.measurement);
  if (options_.estimate_x0 && moments.x0_count > 0) {
    const double prior = double(n_ + 1);
    next.x0_mean = moments.x0 / moments.x0_count;
    Matrix scatter = moments.x0_square - moments.x0_count * next.x0_mean * next.x0_mean.transpose();
    linalg::symmetrise(scatter);
    next.x0_cov = linalg::bounded_below((scatter + prior * x0_prior_) / (moments.x0_count + prior), process_floor_);
  }
  return next;
}

void Estimator::split_noise(Index phases, Parameters& p) const {
  const Index segments = std::max<Index>(1, phases_ / phases);
  for (Noise* noise : {&p.process, &p.measurement}) {
    noise->scale = Vector::Ones(segments);
    for (Index g = 0; g < phases_; ++g) noise->segment[size_t(g)] = std::min(segments - 1, g / phases);
  }
}

bool Estimator::at_floor(const Noise& noise, const Vector& floor) const {
  bool raised = false;
  for (size_t g = 0; g < noise.segment.size() && !raised; ++g)
    linalg::bounded_below(noise.of(Index(g)), 1.01 * floor, &raised);
  return raised;
}

namespace {

// Writer and Reader convert matrices to one list of numbers and back, in the same order.
class Writer {
 public:
  void operator()(const Matrix& a) { values.insert(values.end(), a.data(), a.data() + a.size()); }
  std::vector<double> values;
};

class Reader {
 public:
  explicit Reader(const Vector& values) : values_(values) {}
  Matrix operator()(Index rows, Index cols) {
    const Matrix a = values_.segment(at_, rows * cols).reshaped(rows, cols);
    at_ += rows * cols;
    return a;
  }

 private:
  const Vector& values_;
  Index at_ = 0;
};

}  // namespace

Vector Estimator::coordinates(const Parameters& p) const {
  Writer write;
  const Matrix process = whitener_of(process_reference_), measurement = whitener_of(measurement_reference_);
  const Vector process_units = process_weight_.cwiseSqrt(), measurement_units = measurement_weight_.cwiseSqrt();
  if (options_.estimate_matrices) {
    for (const Matrix& ab : p.ab) write(process * ab * process_units.asDiagonal());
    for (const Matrix& cd : p.cd) write(measurement * cd * measurement_units.asDiagonal());
  }
  for (const Matrix& q : p.process.shape) write(linalg::logarithm(q, process));
  for (const Matrix& r : p.measurement.shape) write(linalg::logarithm(r, measurement));
  write(p.process.scale.array().log().matrix());
  write(p.measurement.scale.array().log().matrix());
  if (options_.estimate_x0) {
    const Matrix w = whitener_of(x0_prior_);
    write(w * p.x0_mean);
    write(linalg::logarithm(p.x0_cov, w));
  }
  return Eigen::Map<const Vector>(write.values.data(), Index(write.values.size()));
}

Parameters Estimator::parameters(const Vector& coordinates, const Parameters& like) const {
  Parameters p = like;
  Reader read(coordinates);
  const auto inverse_of = [](const Matrix& reference) { return linalg::pseudo_inverse(whitener_of(reference)); };
  const Matrix process = inverse_of(process_reference_), measurement = inverse_of(measurement_reference_);
  const Vector process_units = process_weight_.cwiseSqrt().cwiseInverse();
  const Vector measurement_units = measurement_weight_.cwiseSqrt().cwiseInverse();
  if (options_.estimate_matrices) {
    for (Matrix& ab : p.ab) ab = process * read(n_, n_ + r_) * process_units.asDiagonal();
    for (Matrix& cd : p.cd) cd = measurement * read(m_, n_ + r_) * measurement_units.asDiagonal();
  }
  for (Matrix& q : p.process.shape) q = linalg::exponential(read(n_, n_), process);
  for (Matrix& r : p.measurement.shape) r = linalg::exponential(read(m_, m_), measurement);
  p.process.scale = read(p.process.scale.size(), 1).array().exp();
  p.measurement.scale = read(p.measurement.scale.size(), 1).array().exp();
  for (Matrix& q : p.process.shape) q = linalg::bounded_below(q, process_floor_ / p.process.scale.minCoeff());
  for (Matrix& r : p.measurement.shape)
    r = linalg::bounded_below(r, measurement_floor_ / p.measurement.scale.minCoeff());
  if (options_.estimate_x0) {
    const Matrix w = inverse_of(x0_prior_);
    p.x0_mean = w * read(n_, 1);
    p.x0_cov = linalg::bounded_below(linalg::exponential(read(n_, n_), w), process_floor_);
  }
  return p;
}

}  // namespace tokid::em
