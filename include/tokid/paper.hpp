// The numerical example of the paper (section VI), Appendix B and section V, recomputed.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <complex>
#include <cstdint>
#include <string>
#include <vector>

#include "tokid/model.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

// Other numbers are those of the paper: p = p_min = 2, four states, and experiments from zero states with unit Gaussian
// inputs. Because of free responses, all four states can be identified from step 0 on. The reference frame is that of
// step 0 with 3 block rows.
struct PaperOptions {
  Index steps = 80;               // T, at least 50: the printed numbers belong to steps 34 to 37
  Index minimum = 10, more = 50;  // N of case 1 and of case 2; `minimum` is at least N_min = 10
  Index free_responses = 8;       // Nf, at least 4
  Index markov_band = 20;         // largest γ of the compared Markov parameters, more than p
  std::uint64_t seed = 1;
  Execution execution = {};
};

// The results of one case for figures 2 to 5. All errors are absolute; h, u and y are of order one.
struct PaperCase {
  Index experiments = 0;       // N
  double condition_max = 0.0;  // of the scaled windows
  Model model;                 // identified, raw coordinates
  // (T) largest ‖h_{k,k-γ} error‖_F over 1 ≤ γ ≤ p, directly from the regression of step k (28); NaN if none
  Vector direct_error;
  Vector recursive_error;  // (T) largest error over p < γ ≤ markov_band, by recursion over the steps (29)
  Matrix output_error;     // (T × m) simulated minus true outputs for the test inputs
};

// A printed number of Appendix B and the number computed here, in the coordinates of the paper.
struct PrintedNumber {
  std::string equation, quantity;
  std::complex<double> printed, computed;
  double tolerance = 0.0;  // largest difference that counts as agreement, see `agrees`
  // The tolerance is half a unit of the last printed digit for eigenvalues and gains. It is 1e-4, one unit, for the
  // entries of (79)-(81), because their similarity transformation is computed from numbers with four digits. It is
  // 1e-11 for numbers that are zero except for rounding errors.
  bool agrees() const { return std::abs(computed - printed) <= tolerance; }
};

// Eigenvalues by decreasing modulus: a list for each of the T' steps k of the reference frame.
using PoleHistory = std::vector<std::vector<std::complex<double>>>;

struct Paper {
  Index lags = 2;            // p
  Model system;              // the true oscillator
  Matrix test_inputs;        // (T × r)
  PaperCase minimum, more;   // cases 1 and 2
  FramedModel framed;        // case 1 in the reference frame of step 0 with 3 block rows, for the fields below
  PoleHistory open, closed;  // eigenvalues of A'_k, A'_k + G'_k C'_k for k = framed.begin … framed.end-2 (figure 1)
  // (n × T'+1) state errors, from the same initial error at k = framed.begin (figure 6)
  Matrix open_error, closed_error;
  std::vector<double> products;  // ‖Ā_{k+1} Ā_k‖_F (76), from k = framed.begin on
  std::vector<PrintedNumber> printed;
  // smallest over second smallest singular value; small if (79)-(81) follow from the model by one similarity
  // transformation
  double similarity = 0.0;
};

// \throws std::invalid_argument for options outside the ranges above
Paper paper_example(const PaperOptions& options = {});

// Section V: with noise, the identified observer converges to the Kalman filter as p and N grow.
struct KalmanStudyOptions {
  double process_noise = 0.05, measurement_noise = 0.05;  // standard deviations on each state and output
  Index steps = 60;                                       // T
  Index begin = 10, end = 50;                             // steps that are compared, away from both ends
  std::vector<Index> lags = {2, 3, 5, 8, 10, 15, 20};     // p
  std::vector<Index> experiments = {50, 200, 2000, 0};    // N; 0: infinitely many, by expected_moments()
  Index fresh = 500;                                      // new experiments that test the observers
  std::uint64_t seed = 1;
  Execution execution = {};
};

struct KalmanStudyCell {
  Index lags = 0, experiments = 0;  // p, N
  // RMS one-step prediction error on new data over `kalman_error`
  double error = 0.0;
  // RMS over the steps of ‖G_k + A_k K_k‖_F over the RMS of ‖A_k K_k‖_F, in the coordinates of the true system
  double gain = 0.0;
};

struct KalmanStudy {
  KalmanStudyOptions options;
  double kalman_error = 0.0;  // RMS one-step error of the Kalman filter
  // Ordered by N, then by p; cells without a degree of freedom are left out.
  std::vector<KalmanStudyCell> cells;
};
// \throws std::invalid_argument for p < 1, N < 0, noise that is not positive, or a range outside the steps
KalmanStudy kalman_study(const KalmanStudyOptions& options = {});

}  // namespace tokid
