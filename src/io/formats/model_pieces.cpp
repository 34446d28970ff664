// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/model_pieces.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "io/formats/hdf5_sink.hpp"
#include "io/naming.hpp"
#include "io/text.hpp"
#include "tokid/parallel.hpp"

namespace tokid::io {

namespace {

constexpr double piece_bytes = 16e6;

Index steps_of_piece(const Arrays& shapes, Index steps) {
  double bytes = 0.0;
  for (const auto& [name, array] : shapes) bytes += double(stored_bytes(array));
  return std::max<Index>(1, Index(piece_bytes * double(steps) / std::max(1.0, bytes)));
}

}  // namespace

ModelPieces pieces_of(const Model& model) {
  Model part = model;
  part.u_nominal.resize(0, 0), part.y_nominal.resize(0, 0);
  part.step.resize(std::min<size_t>(1, part.step.size()));
  const Index states = model.states(), values = singular_value_count(model);
  ModelPieces result{small_arrays_of(model), step_arrays_of(part, states, values, Layout::plain), {}};
  for (auto& entry : nominal_arrays_of(model)) result.small.push_back(std::move(entry));
  for (auto& [name, array] : result.shapes) array = {array.shape, {}}, array.shape.front() = model.step.size();
  const Index length = steps_of_piece(result.shapes, model.steps());
  result.for_each = [&model, part, states, values, length](const std::function<void(const Arrays&)>& use) mutable {
    for (Index begin = 0; begin < model.steps(); begin += length) {
      checkpoint();
      const auto first = model.step.begin() + begin;
      part.step.assign(first, first + std::min(length, model.steps() - begin));
      use(step_arrays_of(part, states, values, Layout::plain));
    }
  };
  return result;
}

void write_hdf5(const ModelPieces& pieces, const std::filesystem::path& path) {
  for (const auto& [name, array] : pieces.small)
    if (const auto* texts = std::get_if<std::vector<std::string>>(&array.values)) check_texts(name, *texts);
  written_by_library([&] {
    std::uint64_t bytes = 0;
    for (const Arrays* arrays : {&pieces.small, &pieces.shapes})
      for (const auto& [name, array] : *arrays) bytes += stored_bytes(array);
    Hdf5Sink sink(path, bytes);
    for (const auto& [name, array] : pieces.small) sink.write(name, array);
    {
      std::vector<Hdf5Sink::Rows> large;
      std::vector<Index> done(pieces.shapes.size(), 0);
      for (const auto& [name, array] : pieces.shapes) large.emplace_back(sink, name, array.shape);
      pieces.for_each([&](const Arrays& rows) {
        if (rows.size() != large.size())
          throw std::logic_error("steps of a model that hold other fields than the first ones");
        for (size_t i = 0; i < rows.size(); ++i) {
          const Index count = Index(rows[i].second.shape.front());
          large[i].write(done[i], count, std::get<std::vector<double>>(rows[i].second.values).data());
          done[i] += count;
        }
      });
    }
    sink.close();
  });
}

}  // namespace tokid::io
