// What must not allocate: this program counts every call of malloc, Eigen's included.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>

#include "testing.hpp"
#include "tokid/gtv_arx.hpp"

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {
std::atomic<long> allocations{0};
}

extern "C" {
void* __libc_malloc(std::size_t);  // NOLINT: the C library's own name

void* malloc(std::size_t size) {
  allocations.fetch_add(1, std::memory_order_relaxed);
  return __libc_malloc(size);
}
}

namespace tokid {
namespace {

long allocations_of(const Ensemble& e, const GtvArxOptions& options) {
  const long before = allocations;
  gtv_arx(e, options);
  return allocations - before;
}

TEST(Allocation, IsCounted) {
  const long before = allocations;
  const Matrix a = Matrix::Zero(10, 10);
  EXPECT_EQ(allocations - before, 1) << a(0, 0);
}

// However many steps: as many allocations, in every route.
TEST(Allocation, RegressionsAllocateNothingForAStep) {
  for (const Index block : {0, 1, 3}) {
    GtvArxOptions options;
    options.lags = {3};
    options.block = block;
    long counts[2];
    for (const Index steps : {320, 1600}) {
      Ensemble e(40, steps, 2, 2);
      testing::Random random(1);
      for (Index k = 0; k < steps; ++k) {
        e.input(k) = random.matrix(40, 2);
        e.output(k) = random.matrix(40, 2);
      }
      allocations_of(e, options);  // whatever is set up once
      counts[steps == 1600] = allocations_of(e, options);
    }
    EXPECT_LE(counts[1], counts[0] + 4) << block;  // pieces of the loop may differ by one
    EXPECT_LE(counts[0], 1000) << block;
  }
}

}  // namespace
}  // namespace tokid

#endif
