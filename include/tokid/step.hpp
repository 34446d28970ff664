// One step of a model: A_k, B_k, C_k, D_k, G_k and its optional parts, in one block of memory.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "tokid/linalg.hpp"

namespace tokid {

// Numbers in one block of memory. Copies share the block until one of them is written to, which then gets a block of
// its own. Threads may use copies at the same time, as if each had its own block.
class SharedNumbers {
 public:
  SharedNumbers() = default;
  explicit SharedNumbers(Index size);  // zeros
  SharedNumbers(const SharedNumbers& other) noexcept : block_(other.block_) {
    if (block_) block_->owners.fetch_add(1, std::memory_order_relaxed);
  }
  SharedNumbers(SharedNumbers&& other) noexcept : block_(std::exchange(other.block_, nullptr)) {}
  SharedNumbers& operator=(SharedNumbers other) noexcept {
    std::swap(block_, other.block_);
    return *this;
  }
  ~SharedNumbers();

  Index size() const { return block_ ? block_->size : 0; }
  const double* data() const { return block_ ? block_->numbers() : nullptr; }
  Eigen::Map<const Vector> values() const { return {data(), size()}; }
  // For writing. Invalidates data() and values() if the block was shared.
  double* own() {
    if (block_ && block_->owners.load(std::memory_order_acquire) > 1) separate();
    return block_ ? block_->numbers() : nullptr;
  }

 private:
  struct Block {
    std::atomic<std::int32_t> owners;
    Index size;
    double* numbers() { return reinterpret_cast<double*>(this + 1); }
  };
  void separate();

  Block* block_ = nullptr;
};

// Long models have millions of steps with few numbers each. One allocation for each matrix would take three times the
// memory. Copies of a step share their numbers until they are written to, so that a periodic model has them only once.
// Writing to a copy, the functions set_…, which add a part, and forget_…, which remove it, invalidate all views of the
// step.
class Step {
 public:
  using View = Eigen::Map<const Matrix>;
  // operator= accepts only matrices of the same shape. \throws std::invalid_argument. All other operators are those of
  // Eigen, which checks shapes in debug builds only.
  class Writable : public Eigen::Map<Matrix> {
   public:
    using Eigen::Map<Matrix>::Map;
    Writable(const Writable&) = default;
    Writable& operator=(const Writable& other) { return *this = static_cast<const Eigen::Map<Matrix>&>(other); }
    template <class Other>
    Writable& operator=(const Eigen::EigenBase<Other>& other) {
      need_shape(other.rows(), other.cols());
      Eigen::Map<Matrix>::operator=(other.derived());
      return *this;
    }

   private:
    void need_shape(Index found_rows, Index found_cols) const;
  };

  // A step without states and channels.
  Step() = default;
  // Zero matrices for n_k states before and n_{k+1} states after the step, r inputs and m outputs.
  Step(Index states, Index next_states, Index inputs, Index outputs);
  // \throws std::invalid_argument where the shapes disagree
  Step(const Matrix& A, const Matrix& B, const Matrix& C, const Matrix& D, const Matrix& G);

  // True if dimensions, parts and numbers are all equal.
  bool operator==(const Step& other) const;

  Index states() const { return states_; }            // n_k
  Index next_states() const { return next_states_; }  // n_{k+1}
  Index inputs() const { return inputs_; }            // r
  Index outputs() const { return outputs_; }          // m

  View A() const { return view(Part::A); }  // x_{k+1} = A_k x_k + B_k u_k: n_{k+1} × n_k                 (1)
  View B() const { return view(Part::B); }  // n_{k+1} × r
  View C() const { return view(Part::C); }  // y_k = C_k x_k + D_k u_k: m × n_k                           (2)
  View D() const { return view(Part::D); }  // m × r
  View G() const { return view(Part::G); }  // observer gain, n_{k+1} × m: Ā_k = A_k + G_k C_k           (10)
  Writable A() { return writable(Part::A); }
  Writable B() { return writable(Part::B); }
  Writable C() { return writable(Part::C); }
  Writable D() { return writable(Part::D); }
  Writable G() { return writable(Part::G); }
  Matrix closed_loop() const { return A() + G() * C(); }  // Ā_k                                         (10)

  // Copies innovation_cov, singular values, condition, rank and lags of another step.
  void take_diagnostics_of(const Step& other);

  // A copy with only dimensions, condition, rank and lags. Its matrices must not be accessed.
  Step outline() const;

  bool has_matrices() const { return has(Part::A); }

  // Optional parts. The accessors throw std::logic_error if the part is missing.
  bool has_innovation_cov() const { return has(Part::innovation_cov); }
  bool has_Q() const { return has(Part::Q); }
  bool has_R() const { return has(Part::R); }
  bool has_K() const { return has(Part::K); }
  View innovation_cov() const { return view(Part::innovation_cov); }  // m × m
  View Q() const { return view(Part::Q); }  // covariance of the process noise, n_{k+1} × n_{k+1}
  View R() const { return view(Part::R); }  // covariance of the measurement noise, m × m
  View K() const { return view(Part::K); }  // Kalman gain of the filtered state, n_k × m
  // \throws std::invalid_argument for a wrong shape
  void set_innovation_cov(const Matrix& covariance) { set(Part::innovation_cov, covariance); }
  void set_Q(const Matrix& covariance) { set(Part::Q, covariance); }
  void set_R(const Matrix& covariance) { set(Part::R, covariance); }
  void set_K(const Matrix& kalman_gain) { set(Part::K, kalman_gain); }
  void forget_innovation_cov() { forget(Part::innovation_cov); }
  void forget_noise();  // Q, R, K

  // Diagnostics of the identification.
  bool has_singular_values() const { return has(Part::singular_values); }
  bool has_condition() const { return has(Part::condition); }
  bool has_rank() const { return has(Part::rank); }
  bool has_lags() const { return has(Part::lags); }
  // Singular values of H_k, in decreasing order; empty if not known.
  Eigen::Map<const Vector> singular_values() const {
    return {numbers_.data() + begin(Part::singular_values), singular_values_};
  }
  double condition() const { return *at(Part::condition); }           // of the scaled W_k for TVERA, else of [x_k u_k]
  Index rank() const { return static_cast<Index>(*at(Part::rank)); }  // of the matrix of condition()
  Index lags() const { return static_cast<Index>(*at(Part::lags)); }  // p_k
  void set_singular_values(const Vector& values);
  void set_condition(double condition) { set(Part::condition, condition); }
  void set_rank(Index rank) { set(Part::rank, double(rank)); }
  void set_lags(Index lags) { set(Part::lags, double(lags)); }

 private:
  template <class Archive, class S>
  requires std::is_same_v<std::remove_const_t<S>, Step>
  friend void fields(Archive& archive, S& step);  // for messages between processes

  // In the order of their place in memory.
  enum class Part : std::uint8_t { A, B, C, D, G, innovation_cov, Q, R, K, singular_values, condition, rank, lags };
  static constexpr unsigned bit(Part part) { return 1U << unsigned(part); }
  static constexpr unsigned system = 0x1F;  // A to G

  bool has(Part part) const { return (parts_ & bit(part)) != 0; }
  Index rows(Part part) const;
  Index cols(Part part) const;
  Index begin(Part part) const;          // first index in numbers_
  Index begin_besides(Part part) const;  // begin() of the parts after A to G
  void need(Part part) const {
    if (!has(part)) not_known(part);
  }
  [[noreturn]] static void not_known(Part part);
  const double* at(Part part) const {
    need(part);
    return numbers_.data() + begin(part);
  }
  View view(Part part) const { return {at(part), rows(part), cols(part)}; }
  Writable writable(Part part) {
    need(part);
    return {numbers_.own() + begin(part), rows(part), cols(part)};
  }
  void set(Part part, const Matrix& value);
  void set(Part part, double value);
  void forget(Part part);
  double* room_for(Part part, Index size);
  bool whole() const;  // after reading: has numbers_ the size of all parts?

  SharedNumbers numbers_;
  std::int32_t states_ = 0, next_states_ = 0, inputs_ = 0, outputs_ = 0, singular_values_ = 0;
  std::uint32_t parts_ = system;
};

inline Index Step::rows(Part part) const {
  switch (part) {
    case Part::A:
    case Part::B:
    case Part::G:
    case Part::Q:
      return next_states_;
    case Part::C:
    case Part::D:
    case Part::innovation_cov:
    case Part::R:
      return outputs_;
    case Part::K:
      return states_;
    case Part::singular_values:
      return singular_values_;
    default:
      return 1;
  }
}

inline Index Step::cols(Part part) const {
  switch (part) {
    case Part::A:
    case Part::C:
      return states_;
    case Part::B:
    case Part::D:
      return inputs_;
    case Part::G:
    case Part::innovation_cov:
    case Part::R:
    case Part::K:
      return outputs_;
    case Part::Q:
      return next_states_;
    default:
      return 1;
  }
}

inline Index Step::begin(Part part) const {
  const Index n = states_, next = next_states_, r = inputs_, m = outputs_;
  switch (part) {
    case Part::A:
      return 0;
    case Part::B:
      return next * n;
    case Part::C:
      return next * (n + r);
    case Part::D:
      return next * (n + r) + m * n;
    case Part::G:
      return (next + m) * (n + r);
    default:
      return begin_besides(part);
  }
}

}  // namespace tokid
