// Checks tables of an enumeration when they are compiled.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

namespace tokid {

// Does the table have each value of the enumeration, up to its alias `last`, at the index of the value?
template <class Entry, std::size_t size, class Enum>
constexpr bool lists_each_in_order(const Entry (&table)[size], Enum Entry::*value) {
  for (std::size_t i = 0; i < size; ++i)
    if (table[i].*value != Enum(i)) return false;
  return size == std::size_t(Enum::last) + 1;
}

}  // namespace tokid
