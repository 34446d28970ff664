// SPDX-License-Identifier: BSD-3-Clause
#include "model/smoother.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <utility>

#include "base/integers.hpp"
#include "linalg/tall_product.hpp"
#include "model/lane_smoother.hpp"
#include "model/smoother_covariances.hpp"

namespace tokid::kalman {

namespace {

// Limits for the number of experiments in one piece of work, and for the number of pieces. The pieces are the same for
// any number of threads.
constexpr Index smallest_piece = 32, most_pieces = 16;
// At most so many experiments go through all steps together. With many steps they are fewer, so that their numbers
// stay in the cache.
constexpr Index most_together = 64, steps_together = 16000;
// The experiments of a smaller group are computed one by one in lanes: a group has covariances of its own, which take
// as long as those of this many lanes.
constexpr Index smallest_group = 16;
Index together(Index steps) {
  return std::clamp<Index>(steps_together / std::max<Index>(1, steps) / linalg::gram_rows, 1,
                           most_together / linalg::gram_rows) *
         linalg::gram_rows;
}

}  // namespace

// Filters and smooths the means of experiments of one group. Experiments are rows.
// This is the observer (9), split so that the state after its correction by y_k is also available.
class Means {
 public:
  explicit Means(const Samples& samples) : samples_(&samples) {}

  // The rows first … first+count-1 of the samples.
  void filter(const Model& model, const Alike& group, const Covariances& covariances, Index first, Index count,
              Vector& log_likelihood, Matrix* squares = nullptr) {
    arrange(model, group, first, count);
    const double log_two_pi = std::log(2 * std::numbers::pi);
    log_likelihood.segment(first, count).setZero();
    for (Index t = 0; t < group.end; ++t) {
      const size_t s = size_t(t);
      const Step& step = model.step[s];
      const StepCovariance& c = covariances.at(s);
      const std::vector<Index>& there = group.outputs[s];
      correct_means(step, there, c, predicted(s), inputs(s), outputs(s), innovation_, estimated(s));
      if (!there.empty()) {
        linalg::tall_products({{innovation_, c.whitener}}, white_);
        squares_ = white_.array().square().rowwise().sum();
        log_likelihood.segment(first, count).array() -=
            0.5 * (squares_.head(count).array() + weight_ * (c.log_det + double(there.size()) * log_two_pi));
        if (squares) squares->row(t).segment(first, count) = squares_.head(count) / double(there.size());
      }
      advance_means(step, group.unknowns[s], estimated(s), inputs(s), of_unknown_, predicted(s + 1));
    }
  }

  // Replaces filtered means by smoothed ones.
  void smooth(const Model& model, const Alike& group, const Covariances& covariances) {
    for (Index t = group.end - 1; t-- > 0;) {
      const size_t s = size_t(t);
      auto l = estimated(s);
      change_ = estimated(s + 1).leftCols(model.step[s].next_states()) - predicted(s + 1);
      linalg::tall_products(l, {{change_, covariances.at(s).smoother}}, l);
    }
  }

  // Adds the second moments, which are those of the smoothed means and the covariances. If all steps have one sum,
  // those of successive steps are added up first.
  void accumulate(const Model& model, const Alike& group, const Covariances& covariances, Moments& sums) {
    const double represented = weight_ * double(count_);  // experiments
    const bool together = sums.measured_count.size() == 1;
    const auto measured_at = [&](Index t) { return !group.outputs[size_t(t)].empty(); };
    bool begins = true;
    for (Index t = 0; t < group.end; ++t) {
      const size_t s = size_t(t), place = together ? 0 : s;
      const bool measured = measured_at(t), goes_on = t + 1 < group.end;
      const bool ends = !together || t == 0 || t + 2 >= group.end || measured_at(t + 1) != measured;
      if (!covariances.joint_as_before(s)) covariances.join(model, group, s, joint_);
      fill_in(model.step[s], group, s);
      const Index n = model.step[s].states(), m = model.outputs, l = n + model.inputs;
      const Index after = goes_on ? model.step[s].next_states() : 0;
      columns_.clear();
      const auto add = [&](const auto& list, Index columns) {
        for (Index j = 0; j < columns; ++j) columns_.push_back(list.col(j).data());
      };
      add(estimated(s), n);
      add(inputs(s), model.inputs);
      if (goes_on) add(estimated(s + 1), after);
      if (measured) add(outputs(s), m);
      if (begins)
        total_ = represented * joint_.covariance;
      else
        total_ += represented * joint_.covariance;
      linalg::add_gram(columns_, rows_, total_);
      if (goes_on) sums.moved_count(Index(place)) += represented;
      if (measured) sums.measured_count(Index(place)) += represented;
      begins = ends;
      if (!ends) continue;
      if (goes_on) sums.moved[place] += total_.topLeftCorner(l + after, l + after);
      if (measured) {
        auto sum = sums.measured[place];
        sum.topLeftCorner(l, l) += total_.topLeftCorner(l, l);
        sum.bottomLeftCorner(m, l) += total_.bottomLeftCorner(m, l);
        sum.topRightCorner(l, m) += total_.topRightCorner(l, m);
        sum.bottomRightCorner(m, m) += total_.bottomRightCorner(m, m);
      }
      if (t == 0) {
        sums.x0 += estimated(0).topLeftCorner(count_, n).transpose() * samples_->one.segment(first_, count_);
        sums.x0_square += total_.topLeftCorner(n, n);
        sums.x0_count += represented;
      }
    }
  }

  // E[x_k | samples before k], the rows of the experiments and then zeros.
  Eigen::Map<Matrix> predicted(size_t s) { return {memory_.data() + place_[s].predicted, rows_, place_[s].states}; }
  // E[l_k | samples up to k], or given all samples.
  Eigen::Map<Matrix> estimated(size_t s) { return {memory_.data() + place_[s].estimated, rows_, place_[s].latent}; }

 private:
  // Where the numbers of a step begin. The latent vector l_k = [x_k; missing inputs] has `latent` entries.
  struct Place {
    Index inputs = 0, outputs = 0, predicted = 0, estimated = 0, states = 0, latent = 0;
  };

  Eigen::Map<Matrix> inputs(size_t s) { return {memory_.data() + place_[s].inputs, rows_, samples_->u[s].cols()}; }
  Eigen::Map<Matrix> outputs(size_t s) { return {memory_.data() + place_[s].outputs, rows_, samples_->y[s].cols()}; }

  // Replaces the missing samples of a step by their means given all samples, except where no output is available.
  void fill_in(const Step& step, const Alike& group, size_t s) {
    const Index n = step.states(), r = step.inputs();
    const auto l = estimated(s);
    for (size_t i = 0; i < group.unknowns[s].size(); ++i) inputs(s).col(group.unknowns[s][i]) = l.col(n + Index(i));
    if (!partly_missing(group.outputs[s], step.outputs())) return;
    available_ = outputs(s);
    const Matrix& map = joint_.from_states_and_inputs;
    linalg::tall_products(
        {{available_, joint_.from_outputs}, {l.leftCols(n), map.leftCols(n)}, {inputs(s), map.rightCols(r)}},
        outputs(s));
  }

  // Makes room for the experiments, and copies their samples and the mean of x_0.
  void arrange(const Model& model, const Alike& group, Index first, Index count) {
    weight_ = double(samples_->experiments) / double(samples_->rows);
    first_ = first;
    count_ = count;
    rows_ = ceil_div(count, linalg::gram_rows) * linalg::gram_rows;
    place_.resize(size_t(group.end) + 1);
    Index size = 0;
    const auto room = [&](Index columns) { return std::exchange(size, size + rows_ * columns); };
    for (Index t = 0; t <= group.end; ++t) {
      Place& place = place_[size_t(t)];
      const Index n = model.n(model.k_begin + t);
      place.states = n;
      place.predicted = room(n);
      if (t == group.end) break;
      place.latent = n + Index(group.unknowns[size_t(t)].size());
      place.estimated = room(place.latent);
      place.inputs = room(model.inputs);
      place.outputs = room(model.outputs);
    }
    if (Index(memory_.size()) < size) memory_.resize(size_t(size));
    innovation_.resize(rows_, model.outputs);
    white_.resize(rows_, model.outputs);
    const auto put = [&](const auto& samples, Eigen::Map<Matrix> to) {
      to.topRows(count) = samples.middleRows(first, count);
      to.bottomRows(rows_ - count).setZero();
    };
    for (Index t = 0; t < group.end; ++t) {
      put(samples_->u[size_t(t)], inputs(size_t(t)));
      put(samples_->y[size_t(t)], outputs(size_t(t)));
    }
    predicted(0).setZero();
    if (model.x0_mean.size() > 0)
      predicted(0).topRows(count).noalias() = samples_->one.segment(first, count) * model.x0_mean.transpose();
  }

  const Samples* samples_;
  double weight_ = 1.0;                     // experiments per row of the samples
  Index first_ = 0, count_ = 0, rows_ = 0;  // first row, number of rows, and these with rows of zeros
  std::vector<Place> place_;
  std::vector<double> memory_;
  JointCovariance joint_;
  Matrix innovation_, white_, change_, of_unknown_, available_, total_;  // kept to reuse their memory
  Vector squares_;
  std::vector<const double*> columns_;
};

// The experiments in pieces, which threads share. If a group of experiments lies in several pieces, its covariances are
// computed once. The memory of a thread serves one piece after the other.
class Pieces {
 public:
  // With `in_lanes`, small groups are not computed together, but in lanes. Their models must have a constant state
  // dimension.
  explicit Pieces(const Samples& samples, bool in_lanes = false) : samples_(samples), shared_(samples.groups.size()) {
    const Index total = samples.rows, count = std::clamp<Index>(total / smallest_piece, 1, most_pieces);
    for (Index i = 0; i < count; ++i) pieces_.push_back({i * total / count, (i + 1) * total / count, {}, {}});
    for (Piece& piece : pieces_) {
      std::vector<SingleRow> singles;
      for (size_t g = 0; g < samples.groups.size(); ++g) {
        const Alike& group = samples.groups[g];
        const Index first = std::max(group.first, piece.begin), last = std::min(group.first + group.count, piece.end);
        if (first >= last) continue;
        if (in_lanes && samples.groups.size() > 1 && group.count < smallest_group) {
          for (Index row = first; row < last; ++row) singles.push_back({row, &group});
          continue;
        }
        piece.groups.push_back(g);
        if (last < group.first + group.count) shared_[g].emplace();
      }
      for (size_t i = 0; i < singles.size(); i += LaneSamples::lanes)
        piece.lanes.emplace_back(
            samples, std::span(singles).subspan(i, std::min(singles.size() - i, size_t(LaneSamples::lanes))));
    }
  }

  Index count() const { return Index(pieces_.size()); }
  const Samples& samples() const { return samples_; }

  // Calls body(piece, group, covariances, first, count, means) for the experiments of each group in each piece.
  template <class Body>
  void run(const Model& model, bool smooth, const Execution& execution, Body&& body) {
    run(model, smooth, execution, body, [](size_t, const LaneModel&, const LaneSamples&, LaneSmoother&) {});
  }
  // Also calls lane_body(piece, model, samples, smoother) for experiments in lanes.
  template <class Body, class LaneBody>
  void run(const Model& model, bool smooth, const Execution& execution, Body&& body, LaneBody&& lane_body) {
    std::optional<LaneModel> lane_model;
    if (std::ranges::any_of(pieces_, [](const Piece& piece) { return !piece.lanes.empty(); }))
      lane_model.emplace(model, samples_.steps);
    const Execution silent{execution.threads, {}};
    parallel_for(0, Index(shared_.size()), silent, [&](Index begin, Index end) {
      for (Index g = begin; g < end; ++g)
        if (shared_[size_t(g)]) shared_[size_t(g)]->compute(model, samples_, samples_.groups[size_t(g)], smooth);
    });
    const Index threads = std::min(thread_count(execution), count());
    while (Index(memory_.size()) < threads) memory_.push_back({{}, Means(samples_), {}});
    parallel_for(0, threads, execution, [&](Index begin, Index end) {
      for (Index thread = begin; thread < end; ++thread)
        for (Index i = thread; i < count(); i += threads) {
          run_piece(model, smooth, size_t(i), memory_[size_t(thread)], body);
          run_lanes(lane_model, size_t(i), memory_[size_t(thread)], lane_body);
        }
    });
  }

 private:
  struct Piece {
    Index begin = 0, end = 0;        // rows of the samples
    std::vector<size_t> groups;      // computed together
    std::vector<LaneSamples> lanes;  // the other experiments
  };
  struct Memory {
    Covariances covariances;
    Means means;
    std::optional<LaneSmoother> lanes;
  };

  template <class Body>
  void run_piece(const Model& model, bool smooth, size_t i, Memory& memory, Body&& body) {
    const Piece& piece = pieces_[i];
    const Index most = together(samples_.steps);
    for (const size_t g : piece.groups) {
      const Alike& group = samples_.groups[g];
      const Index first = std::max(group.first, piece.begin);
      const Index last = std::min(group.first + group.count, piece.end);
      if (!shared_[g]) memory.covariances.compute(model, samples_, group, smooth);
      const Covariances& covariances = shared_[g] ? *shared_[g] : memory.covariances;
      for (Index now = first; now < last; now += most)
        body(i, group, covariances, now, std::min(most, last - now), memory.means);
    }
  }

  template <class LaneBody>
  void run_lanes(const std::optional<LaneModel>& model, size_t i, Memory& memory, LaneBody& lane_body) {
    for (const LaneSamples& samples : pieces_[i].lanes) {
      if (!memory.lanes || !memory.lanes->fits(*model))
        memory.lanes.emplace(samples_.steps, model->n, model->r, model->m);
      lane_body(i, *model, samples, *memory.lanes);
    }
  }

  const Samples& samples_;
  std::vector<std::optional<Covariances>> shared_;  // of the groups that lie in several pieces
  std::vector<Piece> pieces_;
  std::vector<Memory> memory_;  // of each thread
};

namespace {

Moments empty_moments(const Model& model, Index steps) {
  const Index n = model.n(model.k_begin), l = n + model.inputs;
  Moments sums;
  sums.measured = {steps, l + model.outputs, l + model.outputs};
  sums.moved = {steps, l + n, l + n};
  sums.measured_count = sums.moved_count = Vector::Zero(steps);
  sums.x0 = Vector::Zero(n);
  sums.x0_square = Matrix::Zero(n, n);
  return sums;
}

bool constant_states(const Model& model) {
  const Index n = model.n(model.k_begin);
  return std::ranges::all_of(model.step,
                             [n](const Step& step) { return step.states() == n && step.next_states() == n; });
}

void add(const Moments& part, Moments& sum) {
  sum.measured.together() += part.measured.together();
  sum.moved.together() += part.moved.together();
  sum.measured_count += part.measured_count;
  sum.moved_count += part.moved_count;
  sum.x0 += part.x0;
  sum.x0_square += part.x0_square;
  sum.x0_count += part.x0_count;
}

}  // namespace

Smoother::Smoother(const Samples& samples) : pieces_(std::make_unique<Pieces>(samples, true)) {}
Smoother::~Smoother() = default;

Smoothed Smoother::smooth(const Model& model, const Execution& execution, bool together) {
  const Samples& samples = pieces_->samples();
  if (!constant_states(model)) throw std::logic_error("Smoother: the state dimension of the model is not constant");
  std::vector<Moments> parts(size_t(pieces_->count()), empty_moments(model, together ? 1 : samples.steps));
  Smoothed result{Vector::Zero(samples.rows), {}};
  pieces_->run(
      model, true, execution,
      [&](size_t piece, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(model, group, covariances, first, count, result.log_likelihood);
        means.smooth(model, group, covariances);
        means.accumulate(model, group, covariances, parts[piece]);
      },
      [&](size_t piece, const LaneModel& lane_model, const LaneSamples& lanes, LaneSmoother& smoother) {
        smoother.smooth(lane_model, lanes, result.log_likelihood, parts[piece]);
      });
  result.moments = std::move(parts.front());
  for (size_t i = 1; i < parts.size(); ++i) add(parts[i], result.moments);
  return result;
}

Vector log_likelihoods(const Model& model, const Samples& samples, const Execution& execution) {
  Vector result = Vector::Zero(samples.rows);
  Pieces(samples, constant_states(model))
      .run(
          model, false, execution,
          [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
            means.filter(model, group, covariances, first, count, result);
          },
          [&](size_t, const LaneModel& lane_model, const LaneSamples& lanes, LaneSmoother& smoother) {
            smoother.filter(lane_model, lanes, result);
          });
  return result;
}

Matrix innovation_squares(const Model& model, const Samples& samples) {
  Matrix squares = Matrix::Constant(samples.steps, samples.rows, std::numeric_limits<double>::quiet_NaN());
  Vector log_likelihood = Vector::Zero(samples.rows);
  Pieces(samples).run(
      model, false, {},
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(model, group, covariances, first, count, log_likelihood, &squares);
      });
  return squares;
}

std::vector<Matrix> predicted_states(const Model& model, const Samples& samples) {
  std::vector<Matrix> states;
  for (Index t = 0; t <= samples.steps; ++t)
    states.emplace_back(Matrix::Zero(samples.rows, model.n(model.k_begin + t)));
  Vector log_likelihood = Vector::Zero(samples.rows);
  Pieces(samples).run(
      model, false, {},
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(model, group, covariances, first, count, log_likelihood);
        for (Index t = 0; t <= samples.steps; ++t)
          for (Index i = 0; i < count; ++i)
            states[size_t(t)].row(samples.experiment[size_t(first + i)]) = means.predicted(size_t(t)).row(i);
      });
  return states;
}

Matrix smoothed_first_states(const Model& model, const Samples& samples) {
  Matrix states(samples.rows, model.n(model.k_begin));
  Vector log_likelihood = Vector::Zero(samples.rows);
  Pieces(samples).run(
      model, true, {},
      [&](size_t, const Alike& group, const Covariances& covariances, Index first, Index count, Means& means) {
        means.filter(model, group, covariances, first, count, log_likelihood);
        means.smooth(model, group, covariances);
        for (Index i = 0; i < count; ++i)
          states.row(samples.experiment[size_t(first + i)]) =
              (group.end > 0 ? means.estimated(0) : means.predicted(0)).row(i).head(states.cols());
      });
  return states;
}

}  // namespace tokid::kalman
