// The deadbeat observer of a system that is known: which gains make every error vanish, and after how many steps?
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <tokid/tokid.hpp>

int main() {
  // The time invariant example of Appendix B (73), ten steps of it. The matrices may differ from step to step.
  tokid::Model model;
  model.inputs = model.outputs = 1;
  model.A.assign(10, tokid::Matrix{{1, 0}, {1, 2}});
  model.B.assign(10, tokid::Matrix{{1}, {0}});
  model.C.assign(10, tokid::Matrix{{0, 1}});
  model.D.assign(10, tokid::Matrix{{0}});
  model.state_dim.assign(11, 2);

  const tokid::DeadbeatGain deadbeat = tokid::deadbeat_gain(model);
  model.G = deadbeat.G;
  model.check();
  const std::vector<double> products = tokid::deadbeat_products(model, deadbeat.steps);
  const double largest = *std::max_element(products.begin(), products.end());
  const tokid::Matrix& gain = model.G[5];
  std::printf("G = [%g, %g], errors vanish after %td steps: ||A_k+1 A_k|| of the closed loop <= %.1e\n", gain(0),
              gain(1), deadbeat.steps, largest);
  return (gain - tokid::Matrix{{-1}, {-3}}).norm() < 1e-12 && largest < 1e-12 ? 0 : 1;
}
