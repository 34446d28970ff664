// Reads data sets of an HDF5 file in blocks of their axes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "io/guard/descriptor.hpp"
#include "io/hdf5_handles.hpp"

namespace tokid::io {

class Hdf5Source {
 public:
  // `bytes`: the same file, opened earlier; it must outlive this object. \throws IoError if another file has taken the
  // name since then
  Hdf5Source(const std::filesystem::path& path, const Unchanged& bytes);

  class Samples {
   public:
    Samples(const Hdf5Source& source, const std::string& name);
    int rank() const { return rank_; }
    // Number of entries of the first axis that are stored in one chunk.
    Index stored_together() const { return together_; }
    void read(const Hyperslab& part, double* to);  // row-major. \throws IoError
    // Asks the system to fetch a part that will be read soon. It has an effect only for data sets in one piece.
    void expect(const Hyperslab& part) const;

   private:
    const Hdf5Source& source_;
    std::string name_;
    Handle data_;
    int rank_ = 0;
    Index together_ = 1;
    std::int64_t offset_ = 0;  // position of the first byte of a data set in one piece; negative for other data sets
    std::int64_t item_ = 0;    // bytes of an entry
    std::vector<hsize_t> size_;
  };

 private:
  Handle file_;
  const Unchanged& bytes_;
};

}  // namespace tokid::io
