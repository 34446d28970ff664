// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "linalg/simd.hpp"

namespace tokid::testing {

// A test with each of the instruction sets of this machine.
class OnTarget : public ::testing::TestWithParam<simd::Target> {
 protected:
  void SetUp() override { simd::limit_target(GetParam()); }
  void TearDown() override { simd::limit_target(simd::Target::avx512); }
};

inline auto all_targets() { return ::testing::ValuesIn(simd::targets()); }

inline std::string target_name(const ::testing::TestParamInfo<simd::Target>& target) {
  return "level" + std::to_string(int(target.param));
}

}  // namespace tokid::testing
