// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/text_checksum.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace tokid::io {

struct TextChecksum::State {
  State() { XXH3_64bits_reset(&hash); }
  void update(std::string_view bytes) { XXH3_64bits_update(&hash, bytes.data(), bytes.size()); }

  XXH3_state_t hash;
  bool ends_with_return = false;  // the last byte was "\r"; it is counted unless "\n" follows
};

TextChecksum::TextChecksum() : state_(std::make_unique<State>()) {}

TextChecksum::~TextChecksum() = default;

void TextChecksum::add(std::string_view piece) {
  while (!piece.empty()) {
    if (std::exchange(state_->ends_with_return, false) && piece.front() != '\n') state_->update("\r");
    const size_t end = std::min(piece.find('\r'), piece.size());
    state_->update(piece.substr(0, end));
    state_->ends_with_return = end < piece.size();
    piece.remove_prefix(std::min(end + 1, piece.size()));
  }
}

std::string TextChecksum::digits() {
  if (std::exchange(state_->ends_with_return, false)) state_->update("\r");
  return fmt::format("{:016x}", XXH3_64bits_digest(&state_->hash));
}

}  // namespace tokid::io
