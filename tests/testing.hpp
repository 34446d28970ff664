// Seeded random systems and scaled errors for the property tests.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"
#include "tokid/linalg.hpp"
#include "tokid/model.hpp"

namespace tokid::testing {

inline constexpr double epsilon = std::numeric_limits<double>::epsilon();
inline constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// What a refused call says of it.
template <class Call>
std::string message(Call&& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "no exception";
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double normal() { return normal_(engine_); }
  double uniform(double a, double b) { return a + (b - a) * std::generate_canonical<double, 53>(engine_); }
  Matrix matrix(Index rows, Index cols);
  Matrix orthogonal(Index n);

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

struct SystemSize {
  Index n, m, r;
};

// Independent A_k at every step, each with singular values between 0.7 and 1 times `growth`: above about 1.2 the origin
// is unstable. Nothing is slow, symmetric or sparse about it.
Model random_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed);

// The same matrices at every step.
Model constant_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed);

// A, B, C, D of a step, to go through.
inline constexpr std::array<Step::Writable (Step::*)(), 4> system_parts{&Step::A, &Step::B, &Step::C, &Step::D};

// One part of all steps.
std::vector<Matrix> all(const Model& model, Step::View (Step::*part)() const);
std::vector<Index> state_dims(const Model& model);  // n_k, k_begin ≤ k ≤ k_end
void set_gains(Model& model, const std::vector<Matrix>& G);

Ensemble with_noise(Ensemble e, double sigma, std::uint64_t seed);

// Noise-free experiments with unit Gaussian inputs and initial states of the given size.
Ensemble random_experiments(const Model& system, Index experiments, std::uint64_t seed, double initial = 0.0);

// Largest error of the outputs over the steps where both are known, relative to the largest output of the same step and
// channel: unstable systems are judged at every step, not at the last alone. Infinite where nothing could be compared.
double output_error(const Ensemble& truth, const Ensemble& computed, Index from = 0);

// p with p·m ≥ n.
inline Index smallest_lag_order(const SystemSize& size) { return (size.n + size.m - 1) / size.m; }

std::string name(const SystemSize& s);

std::vector<Index> range(Index begin, Index end);  // begin … end-1

// How many of the texts, or of the findings in words, contain this one.
Index mentions(const std::vector<std::string>& texts, const std::string& part);
Index mentions(const Findings& findings, const std::string& part);

}  // namespace tokid::testing
