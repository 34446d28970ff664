// The observer (9) of all experiments as rows, for samples that arrive step by step. Samples may be missing.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <type_traits>
#include <vector>

#include "model/available_outputs.hpp"
#include "tokid/model.hpp"

namespace tokid::observer {

// The state at the first step of a model, if it is known; as PredictOptions for `initial` and `estimate`.
std::optional<Vector> known_start(const Model& model, InitialState initial, bool estimate);

// The first step of the observer: that of the model if the state there is known, else the first one with all states.
inline Index first_step(const Model& model, const std::optional<Vector>& start) {
  return start ? model.k_begin : model.full_begin();
}

// An experiment is blind while its state is not known. The predictions of a blind experiment are NaN until enough
// samples determine its state again. A row depends on no other row, to the last bit.
class Rows {
 public:
  // Samples of one step (N × channels), a matrix or a part of one.
  using Samples = Eigen::Map<const Matrix, Eigen::Unaligned, Eigen::OuterStride<>>;
  static Samples of(const Matrix& a) { return {a.data(), a.rows(), a.cols(), Eigen::OuterStride<>(a.rows())}; }

  // Starts at step k of the model, which must live as long. x is the state of all experiments, if it is known.
  Rows(const Model& model, Index experiments, Index k, const std::optional<Vector>& x);

  // Allocates all memory of later steps, except that of estimates of unknown states.
  void reserve();

  Index k() const { return k_; }
  bool knows(Index n) const { return since_[size_t(n)] == sees; }

  // x̂_k (N × n_k). The rows of blind experiments are not valid.
  Samples x() const { return {x_.data(), experiments(), n_, Eigen::OuterStride<>(experiments())}; }
  // x̂_k, with rows of NaN for blind experiments.
  Matrix state() const;

  // Advances to step k+1 with u_k (N × r) and y_k (N × m), departures from the nominal trajectory with NaN for missing
  // samples. Sets ŷ_k and y_k - ŷ_k (N × m), with rows of NaN where x̂_k is not known.
  void advance(const Samples& u, const Samples& y, Eigen::Ref<Matrix> prediction, Eigen::Ref<Matrix> innovation);

  // The outputs that were available for the innovations of the last step, of the last row.
  AvailableOutputs& outputs() { return available_; }

  // What later steps need (base/archive.hpp).
  template <class Archive, class R>
  requires std::is_same_v<std::remove_const_t<R>, Rows>
  friend void fields(Archive& archive, R& r) {
    archive(r.k_, r.n_, r.x_, r.since_, r.all_see_, r.recent_u_, r.recent_y_);
  }

 private:
  static constexpr Index sees = -1;

  Index experiments() const { return Index(since_.size()); }
  void blank(Eigen::Ref<Matrix> rows) const;
  const Matrix& without_missing(const Samples& u);
  void correct(const Step& step, const Samples& x, const Samples& u, const Samples& y, Eigen::Ref<Matrix> prediction,
               Eigen::Ref<Matrix> innovation, Eigen::Ref<Matrix> next);
  void fill_in(const Step& step, Matrix& innovations);
  void remember(const Samples& u, const Samples& y);
  void recover();
  bool may_determine(Index n, Index from) const;
  size_t place(Index k) const { return size_t(k % (2 * window_)); }  // of a step in recent_u_ and recent_y_

  const Model& model_;
  Index window_, held_, k_, n_;  // held_: number of states that hold inputs
  Vector x_, next_;              // x̂_k in the first N·n_k numbers; the largest n_k has room
  std::vector<Index> since_;     // (N) first step after the loss of the state, or `sees`
  bool all_see_;
  std::vector<Matrix> recent_u_, recent_y_;  // (2·window) samples of recent steps, if some experiment was blind
  AvailableOutputs available_;
  Matrix u_, seen_;  // values of one step
};

}  // namespace tokid::observer
