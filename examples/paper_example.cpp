// The published closed-loop eigenvalues beside those computed from data alone (Appendix B of the paper).
//
//   paper_example [MODEL]    MODEL: identified from zero-state experiments on the oscillator plus free responses;
//                            without it, such an ensemble is simulated and identified here
//
// Exit status 1 if an eigenvalue differs from the published one in the printed digits.
// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <exception>
#include <string>
#include <tokid/tokid.hpp>
#include <vector>

namespace {

using tokid::Index;

constexpr Index reference_step = 0, block_rows = 3, lags = 2;
// Products and eigenvalues below this count as the rounding errors that they are: the matrices have norms of about ten.
constexpr double rounding = 1e-8;

struct Published {
  Index paper_step;                   // counted from 1
  std::array<double, 2> eigenvalues;  // of A_k + G_k C_k in the reference frame; two more are zero (79)-(81)
  Index step() const { return paper_step - 1; }
};
constexpr Published published[] = {{35, {0.43716, -0.048167}}, {36, {0.31545, -0.097074}}, {37, {-0.14861, 0.048661}}};
constexpr double published_products[] = {1.2e-13, 2.2e-13};  // Frobenius norms of (83) and (82)

tokid::Model model_of_paper() {
  const tokid::Ensemble data =
      tokid::experiments(tokid::oscillator(80), {.experiments = 10, .seed = 1, .free_responses = 8});
  tokid::IdentifyOptions options;
  options.states = 4;
  options.lags = lags;
  return tokid::identify(data, options).model;
}

// Do both agree when they are rounded to five significant digits?
bool agree(double computed, double printed) {
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(printed))) - 4);
  return std::abs(computed - printed) <= 0.5 * unit * (1 + 1e-6);
}

// Largest modulus first.
std::vector<std::complex<double>> eigenvalues(const tokid::Matrix& a) {
  const Eigen::VectorXcd values = a.eigenvalues();
  std::vector<std::complex<double>> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end(), [](auto x, auto y) { return std::abs(x) > std::abs(y); });
  return sorted;
}

bool compare(const tokid::Model& model) {
  bool all = true;
  std::printf("Eigenvalues of A_k + G_k C_k in the reference frame of step %td\n\n", reference_step);
  std::printf("  paper's k   k    published      computed    difference\n");
  for (const Published& row : published) {
    const auto values = eigenvalues(model.closed_loop(row.step()));
    for (size_t i = 0; i < 2; ++i) {
      const double value = values[i].real(), difference = value - row.eigenvalues[i];
      const bool same = agree(value, row.eigenvalues[i]) && std::abs(values[i].imag()) < rounding;
      all = all && same;
      if (i == 0)
        std::printf("  %9td  %2td", row.paper_step, row.step());
      else
        std::printf("  %9s  %2s", "", "");
      std::printf("   %10.5g   %11.7f    %10.1e%s\n", row.eigenvalues[i], value, difference, same ? "" : "   DIFFERS");
    }
    const double rest = std::abs(values[2]);  // of the two others, the larger
    all = all && rest < rounding;
    std::printf("  %9s  %2s   %10s   %11.1e\n", "", "", "0, 0", rest);
  }

  const std::vector<double> products = tokid::deadbeat_products(model, lags);
  std::printf("\nNorms of the products of two successive closed-loop matrices: zero, but for rounding\n\n");
  std::printf("  equation    k, k+1   published   computed\n");
  for (size_t i = 0; i < 2; ++i) {
    const Index k = published[i].step();
    const double norm = products[model.at(k)];
    all = all && norm < rounding;
    std::printf("  (%s)        %td, %td   %9.1e   %8.1e%s\n", i == 0 ? "83" : "82", k, k + 1, published_products[i],
                norm, norm < rounding ? "" : "   DIFFERS");
  }
  return all;
}

int run(const tokid::Model& model) {
  const tokid::FramedModel framed = tokid::reference_frame(model, reference_step, block_rows);
  if (framed.begin > published[0].step() || framed.end <= published[2].step() + 1 || framed.model.states() != 4) {
    std::fprintf(stderr, "paper_example: a model of four states from step 0 to step 37 needed\n");
    return 2;
  }
  const bool all = compare(framed.model);
  std::printf("\n%s\n", all ? "All agree to the printed digits." : "Not all agree to the printed digits.");
  return all ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc > 1 ? tokid::load_model(argv[1]) : model_of_paper());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "paper_example: %s\n", error.what());
    return 2;
  }
}
