// SPDX-License-Identifier: BSD-3-Clause
#include "model/smoother.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

#include "linalg/symmetric.hpp"
#include "model/channels.hpp"
#include "model/kalman_step.hpp"

namespace tokid::kalman {

namespace {

// Limits for the number of experiments in one piece of work, and for the number of pieces. The pieces are the same for
// any number of threads.
constexpr Index smallest_piece = 32, most_pieces = 16;

// The available samples as flags, step by step, inputs before outputs.
std::vector<bool> pattern(const Ensemble& data, Index n, Index begin, Index end, Tail tail) {
  std::vector<bool> present;
  size_t last = 0;
  for (Index k = begin; k < end; ++k) {
    for (Index i = 0; i < data.inputs(); ++i) present.push_back(std::isfinite(data.u(n, k, i)));
    bool any = false;
    for (Index j = 0; j < data.outputs(); ++j) {
      present.push_back(std::isfinite(data.y(n, k, j)));
      any = any || present.back();
    }
    if (any || tail == Tail::keep) last = present.size();
  }
  present.resize(last);
  return present;
}

Alike alike(const std::vector<bool>& present, Index inputs, Index outputs) {
  Alike group;
  group.end = Index(present.size()) / (inputs + outputs);
  auto there = present.begin();
  for (Index t = 0; t < group.end; ++t) {
    group.unknowns.emplace_back();
    group.outputs.emplace_back();
    for (Index i = 0; i < inputs; ++i, ++there)
      if (!*there) group.unknowns.back().push_back(i);
    for (Index j = 0; j < outputs; ++j, ++there)
      if (*there) group.outputs.back().push_back(j);
  }
  return group;
}

// The inputs or the outputs of one step, with experiments as columns. The squares and the number of samples are added
// to `square` and `count`.
Matrix arranged(const Matrix& samples, const Matrix& nominal, Index k, const std::vector<Index>& experiments,
                Vector& square, Vector& count) {
  Matrix result = samples(experiments, Eigen::all).transpose();
  if (k < nominal.rows()) result.colwise() -= nominal.row(k).transpose();
  for (Index c = 0; c < result.cols(); ++c)
    for (Index i = 0; i < result.rows(); ++i) {
      double& value = result(i, c);
      if (!std::isfinite(value)) {
        value = 0.0;
        continue;
      }
      square(i) += value * value;
      count(i) += 1;
    }
  return result;
}

}  // namespace

Samples samples_of(const Model& model, const Ensemble& data, Tail tail, Index steps) {
  check_channels(model, data, true);
  Samples samples;
  samples.experiments = data.experiments();
  samples.steps = std::max<Index>(0, std::min(model.k_end(), data.steps()) - model.k_begin);
  if (steps >= 0) samples.steps = std::min(samples.steps, steps);
  const Index begin = model.k_begin, end = begin + samples.steps;
  std::map<std::vector<bool>, std::vector<Index>> patterns;
  for (Index n = 0; n < data.experiments(); ++n) patterns[pattern(data, n, begin, end, tail)].push_back(n);
  for (const auto& [present, rows] : patterns) {
    Alike group = alike(present, data.inputs(), data.outputs());
    group.first = Index(samples.experiment.size());
    group.count = Index(rows.size());
    samples.experiment.insert(samples.experiment.end(), rows.begin(), rows.end());
    samples.groups.push_back(std::move(group));
  }
  Vector u_count = Vector::Zero(data.inputs()), y_count = Vector::Zero(data.outputs());
  samples.u_square = u_count;
  samples.y_square = y_count;
  for (Index k = begin; k < end; ++k) {
    samples.u.push_back(arranged(data.input(k), model.u_nominal, k, samples.experiment, samples.u_square, u_count));
    samples.y.push_back(arranged(data.output(k), model.y_nominal, k, samples.experiment, samples.y_square, y_count));
  }
  samples.outputs = y_count.sum();
  samples.u_square.array() /= u_count.array().max(1.0);
  samples.y_square.array() /= y_count.array().max(1.0);
  return samples;
}

namespace {

// The covariances of one step and one pattern of missing samples. The latent vector l_k = [x_k; missing inputs] has q
// entries.
struct StepCovariance : Correction {
  Matrix predicted;  // (n × n) of x_{k+1} given the samples up to k
  Matrix smoother;   // J (q × n): the gain from an error of x_{k+1} to l_k
  Matrix smoothed;   // (q × q) of l_k given all samples
};

// both = [a, these columns of b]
void with_columns(const ConstMatrixRef& a, const ConstMatrixRef& b, const std::vector<Index>& columns, Matrix& both) {
  both.resize(a.rows(), a.cols() + Index(columns.size()));
  both.leftCols(a.cols()) = a;
  for (size_t i = 0; i < columns.size(); ++i) both.col(a.cols() + Index(i)) = b.col(columns[i]);
}

class Covariances {
 public:
  // Runs the filter, and with `smooth` also the smoother.
  void compute(const Model& model, const Samples& samples, const Alike& group, bool smooth) {
    step.resize(size_t(group.end));
    Matrix p = Matrix::Zero(model.n(model.k_begin), model.n(model.k_begin));
    if (model.x0_cov.size() > 0) p = model.x0_cov;
    for (Index t = 0; t < group.end; ++t) {
      const size_t s = size_t(t);
      StepCovariance& c = step[s];
      const std::vector<Index>&there = group.outputs[s], &unknown = group.unknowns[s];
      const Index n = p.rows(), q = n + Index(unknown.size());
      prior_.setZero(q, q);
      prior_.topLeftCorner(n, n) = p;
      for (size_t i = 0; i < unknown.size(); ++i) prior_(n + Index(i), n + Index(i)) = samples.u_square(unknown[i]);
      correct_step(model, s, there, unknown, c);
      if (t + 1 == group.end) break;

      with_columns(model.step[s].A(), model.step[s].B(), unknown, f_);
      propagate(c.filtered, f_, model.step[s].Q(), fp_, c.predicted);
      p = c.predicted;
      if (!smooth) continue;
      linalg::inverse_root(p, w_);
      wfp_.noalias() = w_ * fp_;
      c.smoother.noalias() = wfp_.transpose() * w_;
    }
    if (smooth) smooth_backwards(model, group);
  }

  std::vector<StepCovariance> step;

 private:
  void correct_step(const Model& model, size_t s, const std::vector<Index>& there, const std::vector<Index>& unknown,
                    StepCovariance& c) {
    c.log_det = 0.0;
    if (there.empty()) {
      c.filtered = prior_;
      c.gain.setZero(prior_.rows(), model.outputs);
      return;
    }
    with_columns(model.step[s].C(), model.step[s].D(), unknown, h_);
    r_ = model.step[s].R();
    leave_out_missing(there, h_, r_);
    correct(prior_, h_, r_, work_, c);
  }

  // l_k - E[l_k | all samples] = (I - J F)(l_k - E[l_k | y_0 … y_k]) - J (w_k - …): the covariance is a sum of three
  // squares.
  void smooth_backwards(const Model& model, const Alike& group) {
    for (Index t = group.end; t-- > 0;) {
      StepCovariance& c = step[size_t(t)];
      c.smoothed = c.filtered;
      if (t + 1 == group.end) continue;
      const Index n = c.predicted.rows(), q = c.filtered.rows();
      with_columns(model.step[size_t(t)].A(), model.step[size_t(t)].B(), group.unknowns[size_t(t)], f_);
      left_.setIdentity(q, q);
      left_.noalias() -= c.smoother * f_;
      product_.noalias() = left_ * c.filtered;
      c.smoothed.noalias() = product_ * left_.transpose();
      r_ = model.step[size_t(t)].Q() + step[size_t(t) + 1].smoothed.topLeftCorner(n, n);
      product_.noalias() = c.smoother * r_;
      c.smoothed.noalias() += product_ * c.smoother.transpose();
      linalg::symmetrise(c.smoothed);
    }
  }

  Matrix prior_, f_, fp_, w_, wfp_, h_, r_, left_, product_;  // kept to reuse their memory
  Workspace work_;
};

// Filters the means of the columns first … first+count-1 of the samples, all of one group.
// This is the observer (9), split so that the state after its correction by y_k is also available. The kernels of
// observer_step.hpp would be faster: EM of 60 experiments of 40 steps would take 0.89 s instead of 1.02 s. But their
// rounding errors depend on the instruction set. EM amplifies these errors to 6e-11, and tokid promises 1e-12
// (tests/reproducibility_test.cpp).
class Means {
 public:
  Means(const Model& model, const Samples& samples)
      : model_(model), samples_(samples), filtered_(size_t(samples.steps)), predicted_(size_t(samples.steps) + 1) {}

  void filter(const Alike& group, const Covariances& covariances, Index first, Index count, Vector& log_likelihood,
              Matrix* squares = nullptr) {
    const Index n0 = model_.n(model_.k_begin);
    const double log_two_pi = std::log(2 * std::numbers::pi);
    if (model_.x0_mean.size() > 0)
      predicted_[0] = model_.x0_mean.replicate(1, count);
    else
      predicted_[0].setZero(n0, count);
    log_likelihood.segment(first, count).setZero();
    for (Index t = 0; t < group.end; ++t) {
      const size_t s = size_t(t);
      const StepCovariance& c = covariances.step[s];
      const auto u = samples_.u[s].middleCols(first, count);
      const std::vector<Index>&there = group.outputs[s], &unknown = group.unknowns[s];
      const Index n = predicted_[s].rows();
      Matrix& l = filtered_[s];
      l.setZero(n + Index(unknown.size()), count);
      l.topRows(n) = predicted_[s];
      if (!there.empty()) {
        innovation_ = samples_.y[s].middleCols(first, count);
        innovation_.noalias() -= model_.step[s].C() * predicted_[s];
        innovation_.noalias() -= model_.step[s].D() * u;
        each_missing(there, model_.outputs, [this](Index j) { innovation_.row(j).setZero(); });
        l.noalias() += c.gain * innovation_;
        white_.noalias() = c.whitener * innovation_;
        log_likelihood.segment(first, count) -=
            0.5 * (white_.colwise().squaredNorm().array() + (c.log_det + double(there.size()) * log_two_pi))
                      .matrix()
                      .transpose();
        if (squares) squares->row(t).segment(first, count) = white_.colwise().squaredNorm() / double(there.size());
      }
      Matrix& x = predicted_[s + 1];
      x.noalias() = model_.step[s].A() * l.topRows(n);
      x.noalias() += model_.step[s].B() * u;
      for (size_t i = 0; i < unknown.size(); ++i)
        x.noalias() += model_.step[s].B().col(unknown[i]) * l.row(n + Index(i));
    }
  }

  // Replaces filtered means by smoothed ones.
  void smooth(const Alike& group, const Covariances& covariances) {
    for (Index t = group.end - 1; t-- > 0;) {
      const size_t s = size_t(t);
      const Index n = predicted_[s + 1].rows();
      innovation_ = filtered_[s + 1].topRows(n) - predicted_[s + 1];
      filtered_[s].noalias() += covariances.step[s].smoother * innovation_;
    }
  }

  void accumulate(const Alike& group, const Covariances& covariances, Index first, Index count, Moments& sums) {
    const Index r = model_.inputs, m = model_.outputs;
    for (Index t = 0; t < group.end; ++t) {
      const size_t s = size_t(t);
      const StepCovariance& c = covariances.step[s];
      const std::vector<Index>&there = group.outputs[s], &unknown = group.unknowns[s];
      const Index n = model_.step[s].states(), l = n + r;
      const bool goes_on = t + 1 < group.end;
      const Index next = goes_on ? model_.step[s].next_states() : 0;

      // Rows: x_k, u_k, x_{k+1}, y_k.
      const Index all = l + next + m, known = there.empty() ? l + next : all;
      stack_.resize(all, count);
      stack_.topRows(n) = filtered_[s].topRows(n);
      stack_.middleRows(n, r) = samples_.u[s].middleCols(first, count);
      for (size_t i = 0; i < unknown.size(); ++i) stack_.row(n + unknown[i]) = filtered_[s].row(n + Index(i));
      if (goes_on) stack_.middleRows(l, next) = filtered_[s + 1].topRows(next);
      stack_.bottomRows(m) = samples_.y[s].middleCols(first, count);

      covariance_.setZero(all, all);
      place(c.smoothed, n, unknown, covariance_);
      if (goes_on) {
        cross_.noalias() =
            // covariance of x_{k+1} and l_k
            covariances.step[s + 1].smoothed.topLeftCorner(next, next) * c.smoother.transpose();
        covariance_.block(l, 0, next, n) = cross_.leftCols(n);
        for (size_t i = 0; i < unknown.size(); ++i)
          covariance_.block(l, n + unknown[i], next, 1) = cross_.col(n + Index(i));
        covariance_.block(0, l, l, next) = covariance_.block(l, 0, next, l).transpose();
        covariance_.block(l, l, next, next) = covariances.step[s + 1].smoothed.topLeftCorner(next, next);
      }
      if (Index(there.size()) < m && !there.empty()) fill_outputs(s, there, l, next);

      total_ = double(count) * covariance_;
      total_.topLeftCorner(known, known).noalias() += stack_.topRows(known) * stack_.topRows(known).transpose();
      if (goes_on) {
        sums.moved[s] += total_.topLeftCorner(l + next, l + next);
        sums.moved_count(t) += double(count);
      }
      if (!there.empty()) {
        Matrix& measured = sums.measured[s];
        measured.topLeftCorner(l, l) += total_.topLeftCorner(l, l);
        measured.bottomLeftCorner(m, l) += total_.bottomLeftCorner(m, l);
        measured.topRightCorner(l, m) += total_.topRightCorner(l, m);
        measured.bottomRightCorner(m, m) += total_.bottomRightCorner(m, m);
        sums.measured_count(t) += double(count);
      }
      if (t == 0) {
        sums.x0 += stack_.topRows(n).rowwise().sum();
        sums.x0_square += total_.topLeftCorner(n, n);
        sums.x0_count += double(count);
      }
    }
  }

  const Matrix& predicted(size_t s) const { return predicted_[s]; }
  const Matrix& estimated(size_t s) const { return filtered_[s]; }

 private:
  static void place(const Matrix& smoothed, Index n, const std::vector<Index>& unknown, Matrix& covariance) {
    covariance.topLeftCorner(n, n) = smoothed.topLeftCorner(n, n);
    for (size_t i = 0; i < unknown.size(); ++i) {
      const Index from = n + Index(i), to = n + unknown[i];
      covariance.block(to, 0, 1, n) = smoothed.block(from, 0, 1, n);
      covariance.block(0, to, n, 1) = smoothed.block(0, from, n, 1);
      for (size_t j = 0; j < unknown.size(); ++j) covariance(to, n + unknown[j]) = smoothed(from, n + Index(j));
    }
  }

  // Fills in missing outputs from the available outputs and z_k = [x_k; u_k]: y = L y + (I - L) [C D] z + noise. L =
  // R_{·,there} R_{there,there}⁻¹ in the columns of the available outputs.
  void fill_outputs(size_t s, const std::vector<Index>& there, Index l, Index next) {
    const Index m = model_.outputs, y = l + next;
    const Step::View noise = model_.step[s].R();
    // L (m × m), with zero columns for the missing outputs
    cross_ = noise;
    carry_ = noise;
    each_missing(there, m, [this](Index j) {
      cross_.row(j).setZero();
      cross_.col(j).setZero();
      cross_(j, j) = 1.0;
      carry_.col(j).setZero();
    });
    linalg::inverse_root(cross_, w_);
    whitened_.noalias() = carry_ * w_.transpose();
    carry_.noalias() = whitened_ * w_;
    rest_.setIdentity(m, m);
    rest_ -= carry_;
    map_.resize(m, l);
    map_.leftCols(model_.step[s].C().cols()).noalias() = rest_ * model_.step[s].C();
    map_.rightCols(model_.step[s].D().cols()).noalias() = rest_ * model_.step[s].D();
    white_ = stack_.bottomRows(m);
    stack_.bottomRows(m).noalias() = carry_ * white_;
    stack_.bottomRows(m).noalias() += map_ * stack_.topRows(l);
    with_z_.noalias() = map_ * covariance_.topLeftCorner(l, l);
    covariance_.block(y, 0, m, l) = with_z_;
    covariance_.block(0, y, l, m) = with_z_.transpose();
    covariance_.block(y, y, m, m).noalias() = with_z_ * map_.transpose();
    whitened_.noalias() = rest_ * noise;
    covariance_.block(y, y, m, m).noalias() += whitened_ * rest_.transpose();
  }

  const Model& model_;
  const Samples& samples_;
  std::vector<Matrix> filtered_, predicted_;
  Matrix innovation_, white_, stack_, covariance_, cross_, total_;  // kept to reuse their memory
  Matrix w_, carry_, whitened_, rest_, map_, with_z_;
};

struct Piece {
  Index begin = 0, end = 0;  // columns of the samples
};

std::vector<Piece> pieces_of(const Samples& samples) {
  const Index total = samples.experiments, count = std::clamp<Index>(total / smallest_piece, 1, most_pieces);
  std::vector<Piece> pieces;
  for (Index i = 0; i < count; ++i) pieces.push_back({i * total / count, (i + 1) * total / count});
  return pieces;
}

// Calls body(piece, group, covariances, first, count, means) for the experiments of each group in each piece. If a
// group lies in several pieces, its covariances are computed once.
template <class Body>
void run(const Model& model, const Samples& samples, bool smooth, const Execution& execution, Body&& body) {
  const std::vector<Piece> pieces = pieces_of(samples);
  std::vector<std::optional<Covariances>> shared(samples.groups.size());
  for (size_t g = 0; g < samples.groups.size(); ++g) {
    const Alike& group = samples.groups[g];
    for (const Piece& piece : pieces)
      if (group.first < piece.end && piece.end < group.first + group.count) shared[g].emplace();
  }
  const Execution silent{execution.threads, {}};
  parallel_for(0, Index(shared.size()), silent, [&](Index begin, Index end) {
    for (Index g = begin; g < end; ++g)
      if (shared[size_t(g)]) shared[size_t(g)]->compute(model, samples, samples.groups[size_t(g)], smooth);
  });
  parallel_for(0, Index(pieces.size()), execution, [&](Index begin, Index end) {
    Covariances own;
    Means means(model, samples);
    for (Index i = begin; i < end; ++i)
      for (size_t g = 0; g < samples.groups.size(); ++g) {
        const Alike& group = samples.groups[g];
        const Index first = std::max(group.first, pieces[size_t(i)].begin);
        const Index count = std::min(group.first + group.count, pieces[size_t(i)].end) - first;
        if (count <= 0) continue;
        if (!shared[g]) own.compute(model, samples, group, smooth);
        body(size_t(i), group, shared[g] ? *shared[g] : own, first, count, means);
      }
  });
}

Moments empty_moments(const Model& model, Index steps) {
  Moments sums;
  for (size_t s = 0; s < size_t(steps); ++s) {
    const Index l = model.step[s].states() + model.inputs, moved = l + model.step[s].next_states();
    sums.measured.emplace_back(Matrix::Zero(l + model.outputs, l + model.outputs));
    sums.moved.emplace_back(Matrix::Zero(moved, moved));
  }
  sums.measured_count = sums.moved_count = Vector::Zero(steps);
  sums.x0 = Vector::Zero(model.n(model.k_begin));
  sums.x0_square = Matrix::Zero(model.n(model.k_begin), model.n(model.k_begin));
  return sums;
}

void add(const Moments& part, Moments& sum) {
  for (size_t s = 0; s < sum.moved.size(); ++s) {
    sum.measured[s] += part.measured[s];
    sum.moved[s] += part.moved[s];
  }
  sum.measured_count += part.measured_count;
  sum.moved_count += part.moved_count;
  sum.x0 += part.x0;
  sum.x0_square += part.x0_square;
  sum.x0_count += part.x0_count;
}

}  // namespace

Smoothed smooth(const Model& model, const Samples& samples, const Execution& execution) {
  std::vector<Moments> parts(pieces_of(samples).size());
  Smoothed result{Vector::Zero(samples.experiments), {}};
  run(model, samples, true, execution,
      [&](size_t piece, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        if (parts[piece].moved.empty()) parts[piece] = empty_moments(model, samples.steps);
        means.filter(group, covariances, first, count, result.log_likelihood);
        means.smooth(group, covariances);
        means.accumulate(group, covariances, first, count, parts[piece]);
      });
  result.moments = std::move(parts.front());
  for (size_t i = 1; i < parts.size(); ++i) add(parts[i], result.moments);
  return result;
}

Vector log_likelihoods(const Model& model, const Samples& samples, const Execution& execution) {
  Vector result = Vector::Zero(samples.experiments);
  run(model, samples, false, execution,
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(group, covariances, first, count, result);
      });
  return result;
}

Matrix innovation_squares(const Model& model, const Samples& samples) {
  Matrix squares = Matrix::Constant(samples.steps, samples.experiments, std::numeric_limits<double>::quiet_NaN());
  Vector log_likelihood = Vector::Zero(samples.experiments);
  run(model, samples, false, {},
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(group, covariances, first, count, log_likelihood, &squares);
      });
  return squares;
}

std::vector<Matrix> predicted_states(const Model& model, const Samples& samples) {
  std::vector<Matrix> states;
  for (Index t = 0; t <= samples.steps; ++t)
    states.emplace_back(Matrix::Zero(model.n(model.k_begin + t), samples.experiments));
  Vector log_likelihood = Vector::Zero(samples.experiments);
  run(model, samples, false, {},
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(group, covariances, first, count, log_likelihood);
        for (Index t = 0; t <= samples.steps; ++t)
          for (Index i = 0; i < count; ++i)
            states[size_t(t)].col(samples.experiment[size_t(first + i)]) = means.predicted(size_t(t)).col(i);
      });
  return states;
}

Matrix smoothed_first_states(const Model& model, const Samples& samples) {
  Matrix states(model.n(model.k_begin), samples.experiments);
  Vector log_likelihood = Vector::Zero(samples.experiments);
  run(model, samples, true, {},
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(group, covariances, first, count, log_likelihood);
        means.smooth(group, covariances);
        for (Index i = 0; i < count; ++i)
          states.col(samples.experiment[size_t(first + i)]) =
              (group.end > 0 ? means.estimated(0) : means.predicted(0)).col(i).head(states.rows());
      });
  return states;
}

}  // namespace tokid::kalman
