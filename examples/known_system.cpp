// The deadbeat observer of a system that is known: which gains make every error vanish, and after how many steps?
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <tokid/tokid.hpp>

int main() {
  // The time invariant example of Appendix B (73), ten steps of it. The matrices may differ from step to step.
  tokid::Model model;
  model.inputs = model.outputs = 1;
  tokid::Step step(2, 2, 1, 1);  // of zeros, for two states that stay two
  step.A() = tokid::Matrix{{1, 0}, {1, 2}};
  step.B() = tokid::Matrix{{1}, {0}};
  step.C() = tokid::Matrix{{0, 1}};
  model.step.assign(10, step);

  const tokid::DeadbeatGain deadbeat = tokid::deadbeat_gain(model);
  for (tokid::Index k = 0; k < model.k_end(); ++k) model.at(k).G() = deadbeat.G[model.index(k)];
  model.check();
  const std::vector<double> products = tokid::deadbeat_products(model, deadbeat.steps);
  const double largest = *std::max_element(products.begin(), products.end());
  const tokid::Matrix gain = model.at(5).G();
  std::printf("G = [%g, %g], errors vanish after %td steps: ||A_k+1 A_k|| of the closed loop <= %.1e\n", gain(0),
              gain(1), deadbeat.steps, largest);
  return (gain - tokid::Matrix{{-1}, {-3}}).norm() < 1e-12 && largest < 1e-12 ? 0 : 1;
}
