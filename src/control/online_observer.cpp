// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/online_observer.hpp"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>
#include <variant>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/archive.hpp"
#include "base/nan.hpp"
#include "control/system_digest.hpp"
#include "model/continuation.hpp"
#include "model/filter_step.hpp"
#include "model/observer_rows.hpp"
#include "model/observer_step.hpp"

namespace tokid {

namespace online {

using ConstRow = observer::Rows::Samples;  // (1 × size)

ConstRow row_of(const double* data, Index size) { return {data, 1, size, Eigen::OuterStride<>(1)}; }

// The Kalman filter of one experiment.
class Filter {
 public:
  Filter(const Model& model, const Vector& x0, const Matrix& P0, const Vector& input_square)
      : model_(model), input_square_(input_square), k_(model.k_begin), x_(x0.transpose()), y_(1, model.outputs) {
    u_.resize(1, model.inputs);
    covariance_.start(P0);
    for (std::vector<Index>* list : {&there_, &there_before_}) list->reserve(size_t(model.outputs));
    for (std::vector<Index>* list : {&unknown_, &unknown_before_}) list->reserve(size_t(model.inputs));
  }

  ConstRow x() const { return row_of(x_.data(), x_.size()); }

  // Departures from the nominal trajectory, with NaN for missing samples.
  void advance(const ConstRow& u, const ConstRow& y, Observation& shown) {
    const Step& own = step_at(model_, k_);
    const auto prediction = Eigen::Map<Matrix>(shown.prediction.data(), 1, model_.outputs);
    observer::output(own, x(), u, prediction);
    shown.innovation = y.transpose() - shown.prediction;
    sort(u, unknown_, u_);
    sort_available(y);
    const bool same = there_ == there_before_ && unknown_ == unknown_before_;
    const bool settled = k_ > model_.k_begin && covariance_.settled_as(step_at(model_, k_ - 1), own, same);
    if (!settled) covariance_.correct(own, there_, unknown_, input_square_, correction_);
    l_.resize(1, own.states() + Index(unknown_.size()));
    kalman::correct_means(own, there_, correction_, x(), u_, y_, innovation_, l_);
    square(shown);
    next_.resize(1, own.next_states());
    kalman::advance_means(own, unknown_, l_, u_, of_unknown_, next_);
    x_.swap(next_);
    if (!settled) covariance_.advance(own, unknown_, correction_);
    there_.swap(there_before_);
    unknown_.swap(unknown_before_);
    ++k_;
  }

  template <class Archive, class F>
  requires std::is_same_v<std::remove_const_t<F>, Filter>
  friend void fields(Archive& archive, F& f) {
    archive(f.k_, f.x_, f.covariance_, f.correction_, f.there_before_, f.unknown_before_);
  }

 private:
  // Lists the missing samples, and replaces them by zero.
  static void sort(const ConstRow& samples, std::vector<Index>& missing, Matrix& known) {
    missing.clear();
    for (Index i = 0; i < samples.size(); ++i) {
      const bool present = std::isfinite(samples(0, i));
      known(0, i) = present ? samples(0, i) : 0.0;
      if (!present) missing.push_back(i);
    }
  }
  void sort_available(const ConstRow& y) {
    there_.clear();
    for (Index j = 0; j < y.size(); ++j) {
      const bool present = std::isfinite(y(0, j));
      y_(0, j) = present ? y(0, j) : 0.0;
      if (present) there_.push_back(j);
    }
  }

  void square(Observation& shown) const {
    shown.outputs = Index(there_.size());
    shown.normalised_square = nan;
    if (there_.empty()) return;
    double sum = 0.0;
    for (Index i = 0; i < correction_.whitener.rows(); ++i) {
      double white = 0.0;
      for (Index j = 0; j <= i; ++j) white += correction_.whitener(i, j) * innovation_(0, j);  // lower triangular
      sum += white * white;
    }
    shown.normalised_square = sum;
  }

  const Model& model_;
  const Vector& input_square_;
  Index k_;
  Matrix x_, next_, u_, y_, l_, innovation_, of_unknown_;  // rows
  kalman::FilterCovariance covariance_;
  kalman::Correction correction_;
  std::vector<Index> there_, unknown_, there_before_, unknown_before_;
};

// The observer (9) of one experiment.
class Row {
 public:
  Row(const Model& model, const Matrix& whiteners, Index k, const std::optional<Vector>& x0)
      : model_(model), whiteners_(whiteners), rows_(model, 1, k, x0) {
    rows_.reserve();
  }

  bool knows() const { return rows_.knows(0); }
  ConstRow x() const { return rows_.x(); }

  void advance(const ConstRow& u, const ConstRow& y, Observation& shown) {
    const Index k = rows_.k(), m = model_.outputs;
    rows_.advance(u, y, Eigen::Map<Matrix>(shown.prediction.data(), 1, m),
                  Eigen::Map<Matrix>(shown.innovation.data(), 1, m));
    shown.outputs = m;
    if (std::isfinite(shown.innovation.sum())) {
      shown.normalised_square = square(k, shown.innovation);
      return;
    }
    shown.outputs = 0;
    for (const double sample : y.reshaped()) shown.outputs += std::isfinite(sample);
    shown.normalised_square = nan;
    if (shown.outputs == 0 || std::isnan(shown.prediction.sum())) return;
    Eigen::Map<Eigen::RowVectorXd> innovation(shown.innovation.data(), m);
    observer::AvailableOutputs& available = rows_.outputs();
    available.consider(step_at(model_, k), innovation, false);
    shown.normalised_square = available.square(innovation);
  }

  template <class Archive, class R>
  requires std::is_same_v<std::remove_const_t<R>, Row>
  friend void fields(Archive& archive, R& r) { archive(r.rows_); }

 private:
  // ‖W_k ε‖² for a lower triangular W_k
  double square(Index k, const Vector& innovation) const {
    if (whiteners_.size() == 0) return nan;
    const Index m = model_.outputs;
    const Step* const first = model_.step.data();
    const double* w = whiteners_.col(&step_at(model_, k) - first).data();
    double sum = 0.0;
    for (Index i = 0; i < m; ++i) {
      double white = 0.0;
      for (Index j = 0; j <= i; ++j) white += w[i + j * m] * innovation(j);
      sum += white * white;
    }
    return sum;
  }

  const Model& model_;
  const Matrix& whiteners_;  // (m² × S), or empty
  observer::Rows rows_;
};

}  // namespace online

namespace {

Matrix whiteners_of(const Model& model) {
  if (!model.has(&Step::has_innovation_cov)) return {};
  Matrix whiteners(model.outputs * model.outputs, model.steps());
  for (Index s = 0; s < model.steps(); ++s) {
    const Step::View covariance = model.step[size_t(s)].innovation_cov();
    Matrix whitener = linalg::whitener(covariance);
    // An output without variance has no normalised square.
    for (Index j = 0; j < model.outputs; ++j)
      if (!(covariance(j, j) > std::numeric_limits<double>::min())) whitener.row(j).setZero();
    whiteners.col(s) = whitener.reshaped();
  }
  return whiteners;
}

// A sample as departure from the nominal trajectory.
void departure(const Model& model, const Matrix& nominal, Index k, Eigen::Ref<Matrix> sample) {
  subtract_nominal(nominal, nominal_row(model, nominal, k), sample);
}

void check_samples(const char* name, const Eigen::Ref<const Vector>& samples, Index needed) {
  if (samples.size() != needed)
    throw std::invalid_argument(fmt::format("{}: {} samples found, {} needed", name, samples.size(), needed));
  for (const double sample : samples)
    if (std::isinf(sample))
      throw std::invalid_argument(
          fmt::format("{}: an infinite sample found, a finite one needed, or NaN if it is missing", name));
}

}  // namespace

struct OnlineObserver::Content {
  Content(Model given, const OnlineObserverOptions& chosen)
      : model(std::move(given)),
        options(chosen),
        whiteners(whiteners_of(model)),
        u(1, model.inputs),
        y(1, model.outputs),
        ahead(model.states()),
        next(ahead),
        ahead_u(1, model.inputs),
        ahead_y(1, model.outputs) {
    shown.prediction.resize(model.outputs);
    shown.innovation.resize(model.outputs);
    start();
  }

  // The state at the first step, if it is known.
  std::optional<Vector> known_start() const {
    const InitialState initial = options.initial_state.value_or(model.initial_state);
    return observer::known_start(model, initial, options.initial_estimate);
  }

  void start() {
    k = 0;
    const std::optional<Vector> x0 = known_start();
    first = observer::first_step(model, x0);
    if (x0 && options.samples_missing && model.has(&Step::has_Q) && model.has(&Step::has_R)) {
      const InitialState initial = options.initial_state.value_or(model.initial_state);
      const Index n = model.n(model.k_begin);
      const bool uncertain = !starts_from_zero(model, initial) && model.x0_cov.size() > 0;
      running.emplace<online::Filter>(model, *x0, uncertain ? model.x0_cov : Matrix(Matrix::Zero(n, n)),
                                      options.input_square);
    } else {
      running.emplace<online::Row>(model, whiteners, first, x0);
    }
  }

  std::string run() const {
    archive::Writer writer;
    run_fields(writer, *this);
    return writer.bytes();
  }
  void continue_from(std::string_view run) {
    archive::Reader reader(run);
    run_fields(reader, *this);
    reader.finish();
  }
  // Binds a run to its system, and to the kind and the first step of its observer.
  std::uint64_t digest_of(std::string_view run) const {
    const std::uint64_t of_system = digest_of_system(model, model.k_begin, model.k_end());
    const std::uint64_t origin[] = {of_system, running.index(), std::uint64_t(first)};
    return XXH3_64bits_withSeed(run.data(), run.size(), XXH3_64bits(origin, sizeof(origin)));
  }

  bool knows_state() const {
    if (k < first) return false;
    const online::Row* row = std::get_if<online::Row>(&running);
    return !row || row->knows();
  }
  online::ConstRow state() const {
    if (const online::Row* row = std::get_if<online::Row>(&running)) return row->x();
    return std::get<online::Filter>(running).x();
  }

  template <class Archive, class C>
  static void run_fields(Archive& archive, C& content) {
    archive(content.k);
    if (auto* row = std::get_if<online::Row>(&content.running))
      archive(*row);
    else
      archive(std::get<online::Filter>(content.running));
  }

  Model model;
  OnlineObserverOptions options;
  Matrix whiteners;
  std::variant<std::monostate, online::Row, online::Filter> running;
  Index k = 0, first = 0;  // the next step, and the first one of the observer
  Observation shown;
  Matrix u, y;
  Vector ahead, next;  // states of predict(), with room for the largest
  Matrix ahead_u, ahead_y;
};

OnlineObserver::OnlineObserver(Model model, const OnlineObserverOptions& options) {
  model.check();
  if (model.steps() == 0) throw std::invalid_argument("model: no step found, at least one needed");
  if (options.input_square.size() > 0 &&
      (options.input_square.size() != model.inputs || !(options.input_square.array() >= 0).all() ||
       !options.input_square.allFinite()))
    throw std::invalid_argument(
        fmt::format("input_square: {} numbers found, one finite number of at least 0 for each of {} inputs needed",
                    options.input_square.size(), model.inputs));
  content_ = std::make_unique<Content>(std::move(model), options);
}

OnlineObserver::~OnlineObserver() = default;
OnlineObserver::OnlineObserver(OnlineObserver&&) noexcept = default;
OnlineObserver& OnlineObserver::operator=(OnlineObserver&&) noexcept = default;

const Observation& OnlineObserver::step(const Eigen::Ref<const Vector>& u, const Eigen::Ref<const Vector>& y) {
  Content& c = *content_;
  const Model& model = c.model;
  check_samples("u", u, model.inputs);
  check_samples("y", y, model.outputs);
  if (c.k >= model.k_begin && !has_step(model, c.k))
    throw std::invalid_argument(
        fmt::format("step: step {} found, at most {} needed: the model ends there", c.k, model.k_end() - 1));
  if (c.k < c.first) {
    c.shown.prediction.setConstant(nan);
    c.shown.innovation.setConstant(nan);
    c.shown.normalised_square = nan;
    c.shown.outputs = 0;
    for (const double sample : y) c.shown.outputs += std::isfinite(sample);
    ++c.k;
    return c.shown;
  }
  online::Filter* filter = std::get_if<online::Filter>(&c.running);
  if (filter && c.options.input_square.size() == 0 && u.hasNaN())
    throw std::invalid_argument(
        "u: a missing input found, none needed: without input_square the Kalman filter does not know how large it may "
        "be");
  c.u = u.transpose();
  c.y = y.transpose();
  departure(model, model.u_nominal, c.k, c.u);
  departure(model, model.y_nominal, c.k, c.y);
  const auto du = online::row_of(c.u.data(), model.inputs), dy = online::row_of(c.y.data(), model.outputs);
  if (filter)
    filter->advance(du, dy, c.shown);
  else
    std::get<online::Row>(c.running).advance(du, dy, c.shown);
  if (const Index row = nominal_row(model, model.y_nominal, c.k); row >= 0)
    c.shown.prediction += model.y_nominal.row(row).transpose();
  ++c.k;
  return c.shown;
}

Index OnlineObserver::k() const { return content_->k; }
bool OnlineObserver::knows_state() const { return content_->knows_state(); }
const Model& OnlineObserver::model() const { return content_->model; }
void OnlineObserver::reset() { content_->start(); }

std::string OnlineObserver::saved() const {
  const std::string run = content_->run();
  return archive::packed(content_->digest_of(run)) + run;
}

void OnlineObserver::restore(std::string_view bytes) {
  auto restored = std::make_unique<Content>(content_->model, content_->options);
  constexpr size_t head = sizeof(std::uint64_t);
  if (bytes.size() < head ||
      archive::unpacked<std::uint64_t>(bytes.substr(0, head)) != restored->digest_of(bytes.substr(head)))
    throw std::invalid_argument("saved run: other bytes found, those of a run of the same model and options needed");
  restored->continue_from(bytes.substr(head));
  content_ = std::move(restored);
}

Index OnlineObserver::states() const {
  const Content& c = *content_;
  return c.k < c.model.k_begin ? 0 : states_at(c.model, c.k);
}

void OnlineObserver::copy_state(Eigen::Ref<Vector> x) const {
  if (x.size() != states())
    throw std::invalid_argument(fmt::format("x: {} entries found, {} needed", x.size(), states()));
  if (knows_state())
    x = content_->state().transpose();
  else
    x.setConstant(nan);
}

Vector OnlineObserver::state() const {
  Vector x(states());
  copy_state(x);
  return x;
}

Matrix OnlineObserver::predict(const ConstMatrixRef& inputs) const {
  Matrix outputs(inputs.rows(), content_->model.outputs);
  predict(inputs, outputs);
  return outputs;
}

void OnlineObserver::predict(const ConstMatrixRef& inputs, Eigen::Ref<Matrix> outputs) const {
  Content& c = *content_;
  const Model& model = c.model;
  const Index horizon = inputs.rows();
  if (inputs.cols() != model.inputs || outputs.rows() != horizon || outputs.cols() != model.outputs)
    throw std::invalid_argument(fmt::format("inputs: {} x {} found with outputs {} x {}, H x {} and H x {} needed",
                                            inputs.rows(), inputs.cols(), outputs.rows(), outputs.cols(), model.inputs,
                                            model.outputs));
  if (inputs.array().isInf().any())
    throw std::invalid_argument("inputs: an infinite value found, finite ones needed, or NaN for a missing input");
  if (horizon > 0 && (c.k < model.k_begin || !has_step(model, c.k + horizon - 1)))
    throw std::invalid_argument(
        fmt::format("inputs: steps {} to {} found, steps within {} to {} needed, which the model has", c.k,
                    c.k + horizon - 1, model.k_begin, model.k_end() - 1));
  if (!c.knows_state()) {
    outputs.setConstant(nan);
    return;
  }
  Index n = c.state().size();
  c.ahead.head(n) = c.state().transpose();
  for (Index h = 0; h < horizon; ++h) {
    const Step& step = step_at(model, c.k + h);
    c.ahead_u = inputs.middleRows(h, 1);
    departure(model, model.u_nominal, c.k + h, c.ahead_u);
    const auto x = online::row_of(c.ahead.data(), n);
    observer::output(step, x, c.ahead_u, c.ahead_y);
    if (const Index row = nominal_row(model, model.y_nominal, c.k + h); row >= 0) c.ahead_y += model.y_nominal.row(row);
    outputs.middleRows(h, 1) = c.ahead_y;
    n = step.next_states();
    observer::next_state(step, x, c.ahead_u, Eigen::Map<Matrix>(c.next.data(), 1, n));
    c.ahead.swap(c.next);
  }
}

}  // namespace tokid
