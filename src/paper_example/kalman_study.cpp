// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "tokid/example.hpp"
#include "tokid/identify.hpp"
#include "tokid/paper.hpp"

namespace tokid {

namespace {

void check(const KalmanStudyOptions& o) {
  if (!(0 <= o.begin && o.begin < o.end && o.end <= o.steps))
    throw std::invalid_argument(
        fmt::format("compared steps: {} to {} found, 0 <= begin < end <= {} needed", o.begin, o.end, o.steps));
  if (!(o.process_noise > 0 && o.measurement_noise > 0))
    throw std::invalid_argument(fmt::format("noise: standard deviations {} and {} found, positive numbers needed",
                                            o.process_noise, o.measurement_noise));
  for (const Index p : o.lags)
    if (p < 1 || p >= o.steps)
      throw std::invalid_argument(fmt::format("lags: {} found, 1 to {} needed", p, o.steps - 1));
  for (const Index count : o.experiments)
    if (count < 0) throw std::invalid_argument(fmt::format("experiments: {} found, at least 0 needed", count));
  if (o.fresh < 1) throw std::invalid_argument(fmt::format("fresh experiments: {} found, at least 1 needed", o.fresh));
}

// RMS error over the evaluated steps.
double rms_error(const Prediction& prediction, const KalmanStudyOptions& o) {
  double sum = 0.0;
  Index count = 0;
  for (Index k = o.begin; k < o.end; ++k) {
    sum += prediction.innovations[size_t(k)].squaredNorm();
    count += prediction.innovations[size_t(k)].size();
  }
  return std::sqrt(sum / double(count));
}

// RMS of G_k + A_k K_k relative to that of A_k K_k, in the coordinates of the true system. For the Kalman filter, G_k =
// -A_k K_k.
double gain_difference(const Model& model, const Model& filter, const KalmanStudyOptions& o) {
  const Index rows = filter.states() / filter.outputs + 2;
  const FramedModel aligned = align(model, filter, rows);
  double difference = 0.0, size = 0.0;
  for (Index k = std::max(o.begin, aligned.begin); k < std::min(o.end, aligned.end - 1); ++k) {
    const Step::View optimal = filter.at(k).G();
    difference += (aligned.model.at(k).G() - optimal).squaredNorm();
    size += optimal.squaredNorm();
  }
  return std::sqrt(difference / size);
}

}  // namespace

KalmanStudy kalman_study(const KalmanStudyOptions& options) {
  check(options);
  ExperimentOptions experiment_options{
      .seed = options.seed, .process_noise = options.process_noise, .measurement_noise = options.measurement_noise};
  const Model filter = with_noise(oscillator(options.steps), experiment_options);
  experiment_options.experiments = options.fresh;
  experiment_options.seed = options.seed + 1000;  // different from the seed of the training data
  const Ensemble fresh = experiments(filter, experiment_options);

  KalmanStudy study;
  study.options = options;
  study.kalman_error = rms_error(predict(filter, fresh), options);
  experiment_options.seed = options.seed;
  double done = 0.0;
  for (const Index count : options.experiments) {
    experiment_options.experiments = count;
    const Ensemble data = count > 0 ? experiments(filter, experiment_options) : expected_moments(filter);
    for (const Index p : options.lags) {
      if (count > 0 && count <= minimum_experiments(filter.inputs, filter.outputs, p)) continue;
      IdentifyOptions identify_options;
      identify_options.method = Method::tvera;  // the method of the paper
      identify_options.states = filter.states();
      identify_options.lags = p;
      identify_options.initial_state = InitialState::zero;
      identify_options.nominal = NominalChoice::none;
      identify_options.execution = {options.execution.threads, {}};
      const Model model = identify(data, identify_options).model;
      study.cells.push_back({p, count, rms_error(predict(model, fresh), options) / study.kalman_error,
                             gain_difference(model, filter, options)});
    }
    done += 1.0 / double(options.experiments.size());
    if (options.execution.progress) options.execution.progress({.share = std::min(1.0, done)});
  }
  return study;
}

}  // namespace tokid
