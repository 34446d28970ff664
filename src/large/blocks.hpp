// The blocks of a stream: the steps that each block reads and keeps, and the result of one block.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "data/survey.hpp"
#include "diagnose/regressions.hpp"
#include "large/evaluate.hpp"
#include "large/plan_archive.hpp"
#include "tokid/stream.hpp"

namespace tokid::stream {

struct Block {
  Index first = 0, begin = 0, end = 0, last = 0;  // reads first … last-1, keeps begin … end-1
};

// The division of the record into blocks. All blocks have the same plan.
struct BlockLayout {
  Plan plan;
  double hold_out = 0.0;
  Index steps = 0;              // T
  Index count = 0;              // of blocks
  Index before = 0, after = 0;  // steps that a block reads before and after the steps that it keeps
  Index rows = 0;               // block rows of the observability matrices that join neighbours
  Index longest() const { return (steps + count - 1) / count; }
  Block block(Index i) const;
};

struct BlockResult {
  Model model;              // of the steps that the block keeps, counted from step 0 of the record
  Matrix opening, closing;  // observability matrices at `begin` and `end`; `closing` is empty in the last block
  Index read_begin = 0, begin = 0;
  RegressionSurvey regressions;
  Survey samples;                      // of the steps that the block keeps, counted from `begin`
  std::vector<std::uint64_t> digests;  // of the same steps of the training experiments
  ErrorTotals errors;
  std::vector<double> gaps;  // of singular values
  double whiteness_p = std::numeric_limits<double>::quiet_NaN();
};

// `data`: the steps that block i reads.
BlockResult identify_block(Ensemble data, const BlockLayout& layout, Index i);

// A result with the number of its block. It may come from another process.
struct FinishedBlock {
  Index number = -1;
  BlockResult result;
};

// Serialises blocks for messages between processes.
template <class Archive, class B>
requires std::is_same_v<std::remove_const_t<B>, BlockResult>
void fields(Archive& archive, B& b) {
  archive(b.model, b.opening, b.closing, b.read_begin, b.begin, b.regressions, b.samples, b.digests, b.errors, b.gaps,
          b.whiteness_p);
}
template <class Archive, class B>
requires std::is_same_v<std::remove_const_t<B>, FinishedBlock>
void fields(Archive& archive, B& b) { archive(b.number, b.result); }

// Joins the models of the blocks to one model. The blocks must be added in their order.
class Joint {
 public:
  explicit Joint(ModelFile& file) : file_(file) {}
  void add(BlockResult block);
  void finish();

 private:
  ModelFile& file_;
  std::optional<Model> waiting_;  // the previous block; its last step must still be changed to the next coordinates
  Matrix closing_;
};

}  // namespace tokid::stream
