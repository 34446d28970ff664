// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/step.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <new>
#include <stdexcept>

namespace tokid {

namespace {

// Names of the parts, in the order of Step::Part.
constexpr const char* names[] = {
    "A", "B", "C", "D", "G", "innovation_cov", "Q", "R", "K", "singular_values", "condition", "rank", "lags"};

std::int32_t dimension(Index size) {
  if (size < 0 || size > std::numeric_limits<std::int32_t>::max())
    throw std::invalid_argument(fmt::format("step: a dimension of {} found, 0 or more needed", size));
  return static_cast<std::int32_t>(size);
}

void need_shape(const char* name, const Matrix& a, Index rows, Index cols) {
  if (a.rows() != rows || a.cols() != cols)
    throw std::invalid_argument(
        fmt::format("step: {} is {} x {}, {} x {} needed", name, a.rows(), a.cols(), rows, cols));
}

}  // namespace

SharedNumbers::SharedNumbers(Index size) {
  if (size == 0) return;
  static_assert(sizeof(Block) % alignof(double) == 0);
  block_ = new (::operator new(sizeof(Block) + size_t(size) * sizeof(double))) Block{{1}, size};
  std::uninitialized_fill_n(block_->numbers(), size, 0.0);
}

SharedNumbers::~SharedNumbers() {
  if (!block_ || block_->owners.fetch_sub(1, std::memory_order_acq_rel) > 1) return;
  block_->~Block();
  ::operator delete(block_);
}

void SharedNumbers::separate() {
  SharedNumbers copy(size());
  std::copy_n(data(), size(), copy.block_->numbers());
  *this = std::move(copy);
}

void Step::Writable::need_shape(Index found_rows, Index found_cols) const {
  if (found_rows != rows() || found_cols != cols())
    throw std::invalid_argument(
        fmt::format("step: a matrix of {} x {} found, {} x {} needed", found_rows, found_cols, rows(), cols()));
}

Step::Step(Index states, Index next_states, Index inputs, Index outputs)
    : states_(dimension(states)),
      next_states_(dimension(next_states)),
      inputs_(dimension(inputs)),
      outputs_(dimension(outputs)) {
  numbers_ = SharedNumbers(begin_besides(Part::innovation_cov));
}

Step::Step(const Matrix& A, const Matrix& B, const Matrix& C, const Matrix& D, const Matrix& G)
    : Step(A.cols(), A.rows(), B.cols(), C.rows()) {
  need_shape("B", B, next_states_, inputs_);
  need_shape("C", C, outputs_, states_);
  need_shape("D", D, outputs_, inputs_);
  need_shape("G", G, next_states_, outputs_);
  this->A() = A;
  this->B() = B;
  this->C() = C;
  this->D() = D;
  this->G() = G;
}

bool Step::operator==(const Step& other) const {
  return states_ == other.states_ && next_states_ == other.next_states_ && inputs_ == other.inputs_ &&
         outputs_ == other.outputs_ && parts_ == other.parts_ && singular_values_ == other.singular_values_ &&
         (numbers_.data() == other.numbers_.data() || numbers_.values() == other.numbers_.values());
}

Index Step::begin_besides(Part part) const {
  Index result = has(Part::A) ? begin(Part::G) + next_states_ * Index(outputs_) : 0;
  for (auto before = unsigned(Part::innovation_cov); before < unsigned(part); ++before)
    if (has(Part(before))) result += rows(Part(before)) * cols(Part(before));
  return result;
}

// Makes room for `size` numbers of a part, whatever size the part had before. The numbers of the other parts are kept.
double* Step::room_for(Part part, Index size) {
  const Index first = begin(part), found = has(part) ? rows(part) * cols(part) : 0;
  if (found != size) {
    const Index after = numbers_.size() - first - found;
    SharedNumbers numbers(first + size + after);
    std::copy_n(numbers_.data(), first, numbers.own());
    std::copy_n(numbers_.data() + first + found, after, numbers.own() + first + size);
    numbers_ = std::move(numbers);
  }
  parts_ |= bit(part);
  return numbers_.own() + first;
}

void Step::not_known(Part part) { throw std::logic_error(fmt::format("step: {} is not known", names[unsigned(part)])); }

void Step::set(Part part, const Matrix& value) {
  need_shape(names[unsigned(part)], value, rows(part), cols(part));
  std::copy_n(value.data(), value.size(), room_for(part, value.size()));
}

void Step::set(Part part, double value) { *room_for(part, 1) = value; }

void Step::set_singular_values(const Vector& values) {
  const std::int32_t size = dimension(values.size());
  std::copy_n(values.data(), size, room_for(Part::singular_values, size));
  singular_values_ = size;
}

void Step::forget(Part part) {
  room_for(part, 0);
  parts_ &= ~bit(part);
}

void Step::forget_noise() {
  for (const Part part : {Part::Q, Part::R, Part::K}) forget(part);
}

void Step::take_diagnostics_of(const Step& other) {
  if (other.has_innovation_cov()) set_innovation_cov(other.innovation_cov());
  if (other.has_singular_values()) set_singular_values(other.singular_values());
  if (other.has_condition()) set_condition(other.condition());
  if (other.has_rank()) set_rank(other.rank());
  if (other.has_lags()) set_lags(other.lags());
}

Step Step::outline() const {
  Step result;
  result.states_ = states_, result.next_states_ = next_states_, result.inputs_ = inputs_, result.outputs_ = outputs_;
  result.parts_ = parts_ & (bit(Part::condition) | bit(Part::rank) | bit(Part::lags));
  const Index first = begin_besides(Part::condition);
  result.numbers_ = SharedNumbers(numbers_.size() - first);
  std::copy_n(numbers_.data() + first, result.numbers_.size(), result.numbers_.own());
  return result;
}

bool Step::whole() const {
  constexpr std::int32_t most = 1'000'000;  // then no product overflows
  for (const std::int32_t size : {states_, next_states_, inputs_, outputs_, singular_values_})
    if (size < 0 || size > most) return false;
  constexpr auto all = Part(unsigned(Part::lags) + 1);
  if ((parts_ & system) != system || parts_ >= bit(all) || numbers_.size() != begin_besides(all)) return false;
  if (!has_singular_values() && singular_values_ != 0) return false;
  const auto counts = [this](Part part) { return !has(part) || (*at(part) >= 0 && *at(part) < 0x1p52); };
  return counts(Part::rank) && counts(Part::lags);
}

}  // namespace tokid
