// The blocks of a stream: which steps each of them keeps and reads, and what one of them yields.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string_view>

#include "data/survey.hpp"
#include "diagnose/regressions.hpp"
#include "large/evaluate.hpp"
#include "large/plan_archive.hpp"
#include "tokid/stream.hpp"

namespace tokid::stream {

struct Block {
  Index first = 0, begin = 0, end = 0, last = 0;  // reads first … last-1, keeps begin … end-1
};

// The record in blocks, all of which follow one plan.
struct BlockLayout {
  Plan plan;
  double hold_out = 0.0;
  Index steps = 0;               // T
  Index count = 0;               // of blocks
  Index before = 0, behind = 0;  // steps read beyond those kept
  Index rows = 0;                // block rows of the observability matrices that neighbours are joined by
  Index longest() const { return (steps + count - 1) / count; }
  Block block(Index i) const;
};

struct BlockResult {
  Model model;              // of the steps kept, counted from step 0 of the record on
  Matrix opening, closing;  // O_begin and O_end; the latter is empty at the end of the record
  Index read_begin = 0, begin = 0;
  RegressionSurvey regressions;
  Survey samples;                      // of the steps kept, counted from `begin` on
  std::vector<std::uint64_t> digests;  // of the same, of the experiments that are identified from
  ErrorTotals errors;
  std::vector<double> gaps;  // of singular values
  double whiteness_p = std::numeric_limits<double>::quiet_NaN();
};

// `data` are the steps that block i reads.
BlockResult identify_block(Ensemble data, const BlockLayout& layout, Index i);

// With its number, as it comes from other processes and from the journal of an earlier call.
struct FinishedBlock {
  Index number = -1;
  BlockResult result;
};

// Of `inputs` and `outputs`, from bytes that somebody else may have written. \throws std::runtime_error,
// std::invalid_argument where they are no block of this layout
FinishedBlock finished_block(std::string_view bytes, const BlockLayout& layout, Index inputs, Index outputs);

// For messages between processes.
template <class Archive, class B>
requires std::is_same_v<std::remove_const_t<B>, BlockResult>
void fields(Archive& archive, B& b) {
  archive(b.model, b.opening, b.closing, b.read_begin, b.begin, b.regressions, b.samples, b.digests, b.errors, b.gaps,
          b.whiteness_p);
}
template <class Archive, class B>
requires std::is_same_v<std::remove_const_t<B>, FinishedBlock>
void fields(Archive& archive, B& b) { archive(b.number, b.result); }

// The blocks in their order, as one model.
class Joint {
 public:
  explicit Joint(ModelFile& file) : file_(file) {}
  void add(BlockResult block);
  void finish();

 private:
  ModelFile& file_;
  std::optional<Model> waiting_;  // its last step leads into the coordinates of the next block
  Matrix closing_;
};

}  // namespace tokid::stream
