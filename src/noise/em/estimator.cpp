// SPDX-License-Identifier: BSD-3-Clause
#include "noise/em/estimator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "linalg/elementary.hpp"
#include "linalg/symmetric.hpp"
#include "noise/random_walk_lanes.hpp"
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

}  // namespace

bool Parameters::finite() const {
  const auto all = [](const std::vector<Matrix>& list) {
    return std::all_of(list.begin(), list.end(), [](const Matrix& a) { return a.allFinite(); });
  };
  return ab.together().allFinite() && cd.together().allFinite() && all(process.shape) && all(measurement.shape) &&
         process.scale.allFinite() && measurement.scale.allFinite() && x0_mean.allFinite() && x0_cov.allFinite();
}

Estimator::Estimator(const Model& start, const kalman::Samples& samples, const EstimatorOptions& options)
    : options_(options),
      n_(start.states()),
      r_(start.inputs),
      m_(start.outputs),
      steps_(samples.steps),
      phases_(options.period > 0 ? std::min(options.period, samples.steps) : samples.steps),
      pooled_(options.smoothing > 0) {
  // A phase starts with the mean of the matrices of its steps.
  std::vector<Matrix> q(size_t(phases_), Matrix::Zero(n_, n_)), r(size_t(phases_), Matrix::Zero(m_, m_));
  start_.ab = {phases_, n_, n_ + r_};
  start_.cd = {phases_, m_, n_ + r_};
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

void Estimator::write(const Parameters& p, Model& model) const {
  for (Index t = 0; t < steps_; ++t) {
    const Index g = t % phases_;
    Step& step = model.step[size_t(t)];
    const auto ab = p.ab[size_t(g)], cd = p.cd[size_t(g)];
    step.A() = ab.leftCols(n_);
    step.B() = ab.rightCols(r_);
    step.C() = cd.leftCols(n_);
    step.D() = cd.rightCols(r_);
    step.set_Q(p.process.of(g));
    step.set_R(p.measurement.of(g));
  }
  model.x0_mean = p.x0_mean;
  model.x0_cov = p.x0_cov;
}

namespace {

// A typical value of each of the diagonal entries first … first+size-1: the geometric mean over the steps at which the
// entry is not zero. With this mean, a state that grows by orders of magnitude is not dominated by its last steps.
Vector typical(const linalg::MatrixList& moments, Index first, Index size) {
  Vector logs = Vector::Zero(size), count = logs;
  for (size_t s = 0; s < size_t(moments.size()); ++s)
    for (Index i = 0; i < size; ++i)
      if (const double a = moments[s](first + i, first + i); a > 0) logs(i) += linalg::log(a), count(i) += 1;
  return (count.array() > 0).select((logs.array() / count.array().max(1.0)).unaryExpr(&linalg::exp), 0.0);
}

}  // namespace

void Estimator::set_scales(const kalman::Moments& moments, const kalman::Samples& samples) {
  const double experiments = double(std::max<Index>(1, samples.experiments));
  const auto weight = [&](const linalg::MatrixList& list) {
    // Of one phase: the mean over its steps, times their number.
    Vector w = typical(list, 0, n_ + r_) * double(list.size()) / double(phases_);
    for (double& value : w)
      if (!(value > 0)) value = experiments;  // a signal that is zero may have any weight
    return w;
  };
  variation_.jumps = options_.jumps;
  variation_.process_weight = weight(moments.moved);
  variation_.measurement_weight = weight(moments.measured);
  const double count = std::max(1.0, moments.measured_count.sum());
  Matrix state = Matrix::Zero(n_, n_);  // mean second moment
  for (size_t s = 0; s < size_t(moments.measured.size()); ++s)
    state += moments.measured[s].topLeftCorner(n_, n_) / count;
  process_floor_ = (smallest_noise * state.diagonal()).array().max(1e-300);
  measurement_floor_ = (smallest_noise * samples.y_square).array().max(1e-300);
  for (Matrix& q : start_.process.shape) q = linalg::bounded_below(q, process_floor_);
  for (Matrix& r : start_.measurement.shape) r = linalg::bounded_below(r, measurement_floor_);
  // The second moment of the state at a typical step, times the ratio of innovations to outputs.
  const double of_step = double(std::max<Index>(1, (moments.measured_count.array() > 0).count())) / count;
  const Vector size = (typical(moments.measured, 0, n_) * of_step).cwiseMax(process_floor_);
  const Vector scale = (size.array() / state.diagonal().array().max(process_floor_.array())).sqrt();
  state = scale.asDiagonal() * state * scale.asDiagonal();
  variation_.measurement_reference = linalg::bounded_below(options_.innovation_cov, measurement_floor_);
  const Vector output = (typical(moments.measured, n_ + r_, m_) * of_step).cwiseMax(measurement_floor_);
  const double ratio = (variation_.measurement_reference.diagonal().array() / output.array()).mean();
  variation_.process_reference = linalg::bounded_below(ratio * state, process_floor_);
  const auto per_phase = [&](const Vector& counts) {
    Vector sums = Vector::Zero(phases_);
    for (Index t = 0; t < counts.size(); ++t) sums(t % phases_) += counts(t);
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

// Σ_g count_g log det of the noise of phase g
double log_determinants(const Noise& noise, const Vector& counts) {
  Matrix w;
  const double shape = linalg::inverse_root(noise.shape[0], w), size = double(noise.shape[0].rows());
  double sum = 0.0;
  for (size_t g = 0; g < noise.segment.size(); ++g)
    sum += counts(Index(g)) * (shape + size * linalg::log(noise.scale(noise.segment[g])));
  return sum;
}

}  // namespace

double Estimator::penalty(const Parameters& p) const {
  double sum = 0.0;
  if (options_.smoothing > 0 && phases_ > 1) sum += options_.smoothing * variation_.of(p.ab, p.cd);
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

std::optional<Parameters> Estimator::with_less_penalty(const Parameters& p) const {
  if (!(options_.smoothing > 0) || !options_.estimate_matrices || phases_ < steps_ || phases_ < 2 || n_ == 0)
    return std::nullopt;
  std::optional<Coordinates> found = with_less_variation(p.ab, p.cd, variation_);
  if (!found) return std::nullopt;
  Parameters result = p;
  result.ab = std::move(found->ab);
  result.cd = std::move(found->cd);
  Matrix mean = Matrix::Zero(n_, n_);
  for (size_t k = 1; k <= size_t(steps_); ++k)
    mean += found->s[k] * p.process.shape[0] * found->s[k].transpose() / double(steps_);
  linalg::symmetrise(mean);
  result.process.shape[0] = linalg::bounded_below(mean, process_floor_);
  return result;
}

linalg::MatrixList Estimator::phase_roots(const linalg::MatrixList& moments) const {
  linalg::MatrixList sums(phases_, moments.rows(), moments.cols());
  for (Index t = 0; t < moments.size(); ++t) sums[size_t(t % phases_)] += moments[size_t(t)];
  for (size_t g = 0; g < size_t(phases_); ++g) linalg::take_upper_root(sums[g]);
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

Estimator::Walks Estimator::walks_of(const linalg::MatrixList& roots, const Noise& noise, Index l,
                                     const Matrix& reference, const Vector& weight) const {
  const Index q = reference.rows();
  const Matrix whitener = whitener_of(reference);
  const linalg::Svd eigen = linalg::svd(whitener * noise.shape[0] * whitener.transpose());
  if (q > 0 && !(eigen.s(q - 1) > std::numeric_limits<double>::epsilon() * eigen.s(0) && std::isfinite(eigen.s(0))))
    throw std::runtime_error("EM has diverged: the covariance of the noise is singular. Start from another model");
  Walks walks{eigen.u.transpose() * whitener, eigen.s, {phases_, l, l + q}, {}};
  walks.stiffness = (options_.smoothing * weight.head(l) * eigen.s.transpose()).cwiseSqrt();
  for (Index g = 0; g < phases_; ++g) {
    const auto root = roots[size_t(g)];
    auto block = walks.rows[size_t(g)];
    block.leftCols(l) = root.topLeftCorner(l, l);
    block.rightCols(q).noalias() = root.topRightCorner(l, q).lazyProduct(walks.t.transpose());
    block /= std::sqrt(noise.scale(noise.segment[size_t(g)]));
  }
  return walks;
}

namespace {

// Each phase has its own regression. Only the first `l` of the n + r coefficients are estimated, and the others keep
// their values.
void regress_each(const linalg::MatrixList& roots, Index l, Index q, linalg::MatrixList& coefficients) {
  if (q == 0 || l == 0) return;
  std::vector<Matrix> rows;
  for (size_t g = 0; g < size_t(roots.size()); ++g)
    rows.push_back(linalg::beside(roots[g].topLeftCorner(l, l), roots[g].topRightCorner(l, q)));
  const std::vector<Matrix> theta = random_walk_regression(rows, l, Vector::Zero(l));
  for (size_t g = 0; g < theta.size(); ++g)
    if (!rows[g].leftCols(l).isZero(0.0)) coefficients[g].leftCols(l) = theta[g].transpose();
}

}  // namespace

void Estimator::regress(const linalg::MatrixList& process, const linalg::MatrixList& output, const Parameters& p,
                        Parameters& next) const {
  const Index all = n_ + r_, of_outputs = options_.feedthrough ? all : n_;
  if (!pooled_ || phases_ == 1) {
    regress_each(process, all, n_, next.ab);
    regress_each(output, of_outputs, m_, next.cd);
    return;
  }
  const Walks walks[] = {
      walks_of(process, p.process, all, variation_.process_reference, variation_.process_weight),
      walks_of(output, p.measurement, of_outputs, variation_.measurement_reference, variation_.measurement_weight)};
  const Matrix back[] = {linalg::pseudo_inverse(walks[0].t), linalg::pseudo_inverse(walks[1].t)};
  const WalkRows rows[] = {{walks[0].rows, walks[0].stiffness}, {walks[1].rows, walks[1].stiffness}};
  linalg::MatrixList* const coefficients[] = {&next.ab, &next.cd};
  for (const auto& [begin, end] : stretches()) {
    const std::vector<linalg::MatrixList> rotated = random_walk_regressions(rows, begin, end);
    for (const size_t i : {0u, 1u})
      for (Index g = begin; g < end; ++g)
        (*coefficients[i])[size_t(g)].leftCols(rotated[i].cols()).noalias() =
            back[i].lazyProduct(rotated[i][size_t(g - begin)]);
  }
}

void Estimator::update_noise(const linalg::MatrixList& roots, const Vector& counts,
                             const linalg::MatrixList& coefficients, const Vector& floor, double spent,
                             Noise& noise) const {
  const Index l = n_ + r_, q = floor.size();
  if (q == 0) return;
  // The sums of squared residuals of the segments, or of the phases.
  linalg::MatrixList residual(pooled_ ? noise.scale.size() : phases_, q, q);
  Vector samples = Vector::Zero(residual.size());
  Matrix misfit(l, q);
  for (size_t g = 0; g < size_t(phases_); ++g) {
    const size_t i = pooled_ ? size_t(noise.segment[g]) : g;
    misfit = roots[g].topRightCorner(l, q);
    misfit.noalias() -= roots[g].topLeftCorner(l, l).lazyProduct(coefficients[g].transpose());
    residual[i].noalias() += misfit.transpose().lazyProduct(misfit);
    const auto rest = roots[g].bottomRightCorner(q, q);
    residual[i].noalias() += rest.transpose().lazyProduct(rest);
    samples(Index(i)) += counts(Index(g));
  }
  if (!pooled_) {
    for (size_t g = 0; g < size_t(phases_); ++g)
      if (samples(Index(g)) > 0) noise.shape[g] = linalg::bounded_below(residual[g] / samples(Index(g)), floor);
    return;
  }
  if (!(samples.sum() > 0)) return;
  Matrix sum = Matrix::Zero(q, q);
  for (Index i = 0; i < noise.scale.size(); ++i) sum += residual[size_t(i)] / noise.scale(i);
  Matrix& shape = noise.shape[0];
  shape = linalg::bounded_below(sum / (samples.sum() * (1 - spent)), floor / noise.scale.minCoeff());
  if (noise.scale.size() == 1) return;
  const Matrix w = whitener_of(shape);
  // The smallest scale that keeps all variances above the floor.
  const double least = linalg::singular_values(w * floor.asDiagonal() * w.transpose())(0);
  for (Index i = 0; i < noise.scale.size(); ++i) {
    const double squares = (w * residual[size_t(i)] * w.transpose()).trace();
    if (samples(i) > 0) noise.scale(i) = std::max(least, squares / (double(q) * samples(i) * (1 - spent)));
  }
}

Parameters Estimator::maximise(const kalman::Moments& moments, const Parameters& p) const {
  Parameters next = p;
  const linalg::MatrixList process = phase_roots(moments.moved);
  const linalg::MatrixList output = phase_roots(moments.measured);
  if (options_.estimate_matrices) regress(process, output, p, next);
  update_noise(process, moved_, next.ab, process_floor_, process_spent_, next.process);
  update_noise(output, measured_, next.cd, measurement_floor_, measurement_spent_, next.measurement);
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

// left Θ_g diag(right) for all phases
Matrix in_units(const linalg::MatrixList& theta, const Matrix& left, const Vector& right) {
  Matrix result = left * theta.together();
  result *= right.replicate(theta.size(), 1).asDiagonal();
  return result;
}

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
  const Matrix process = whitener_of(variation_.process_reference),
               measurement = whitener_of(variation_.measurement_reference);
  const Vector process_units = variation_.process_weight.cwiseSqrt(),
               measurement_units = variation_.measurement_weight.cwiseSqrt();
  if (options_.estimate_matrices) {
    write(in_units(p.ab, process, process_units));
    write(in_units(p.cd, measurement, measurement_units));
  }
  for (const Matrix& q : p.process.shape) write(linalg::logarithm(q, process));
  for (const Matrix& r : p.measurement.shape) write(linalg::logarithm(r, measurement));
  write(p.process.scale.unaryExpr(&linalg::log));
  write(p.measurement.scale.unaryExpr(&linalg::log));
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
  const Matrix process = inverse_of(variation_.process_reference),
               measurement = inverse_of(variation_.measurement_reference);
  const Vector process_units = variation_.process_weight.cwiseSqrt().cwiseInverse();
  const Vector measurement_units = variation_.measurement_weight.cwiseSqrt().cwiseInverse();
  if (options_.estimate_matrices) {
    p.ab.together() = read(n_, (n_ + r_) * phases_);
    p.cd.together() = read(m_, (n_ + r_) * phases_);
    p.ab.together() = in_units(p.ab, process, process_units);
    p.cd.together() = in_units(p.cd, measurement, measurement_units);
  }
  for (Matrix& q : p.process.shape) q = linalg::exponential(read(n_, n_), process);
  for (Matrix& r : p.measurement.shape) r = linalg::exponential(read(m_, m_), measurement);
  p.process.scale = read(p.process.scale.size(), 1).unaryExpr(&linalg::exp);
  p.measurement.scale = read(p.measurement.scale.size(), 1).unaryExpr(&linalg::exp);
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
