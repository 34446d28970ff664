// The names of the choices about feedthrough, and their reasons in words.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "base/enum_table.hpp"
#include "tokid/options.hpp"

namespace tokid {

namespace {

using FeedthroughReason = FeedthroughChoice::Reason;

struct FeedthroughEntry {
  FeedthroughReason reason;
  const char *name, *words;
};

constexpr FeedthroughEntry feedthrough_reasons[] = {
    {FeedthroughReason::stated, "stated", "as asked"},
    {FeedthroughReason::exact, "exact", "exact in data without noise"},
    {FeedthroughReason::no_response, "no_response", "no response of the outputs to the inputs of the same step found"},
    {FeedthroughReason::response, "response", "the outputs respond to the inputs of the same step"},
    {FeedthroughReason::feedback, "feedback",
     "the outputs and inputs of a step are correlated, by feedthrough or by feedback within the step"},
    {FeedthroughReason::untested, "untested", "the samples do not tell whether it is zero"},
    {FeedthroughReason::unknown, "unknown", "nothing is known of the choice"},
};

static_assert(lists_each_in_order(feedthrough_reasons, &FeedthroughEntry::reason));

}  // namespace

const char* to_string(FeedthroughChoice::Reason reason) { return feedthrough_reasons[size_t(reason)].name; }

std::string in_words(const FeedthroughChoice& choice) {
  return fmt::format("{}, {}", choice.present ? "D is estimated" : "D = 0",
                     feedthrough_reasons[size_t(choice.reason)].words);
}

}  // namespace tokid
