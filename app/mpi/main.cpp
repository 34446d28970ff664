// tokid-mpi: the processes of mpirun share the blocks of identify and the files of update. The first process alone runs
// all other commands.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "tool.hpp"

namespace {

constexpr int sizes_tag = 1, bytes_tag = 2;
// MPI counts bytes in an int.
constexpr std::int64_t most_at_once = std::int64_t{1} << 30;

void send(const std::string& bytes, int to) {
  std::int64_t rest = std::int64_t(bytes.size());
  MPI_Send(&rest, 1, MPI_INT64_T, to, sizes_tag, MPI_COMM_WORLD);
  for (const char* from = bytes.data(); rest > 0;) {
    const std::int64_t count = std::min(rest, most_at_once);
    MPI_Send(from, int(count), MPI_BYTE, to, bytes_tag, MPI_COMM_WORLD);
    from += count, rest -= count;
  }
}

std::string receive(int from) {
  std::int64_t rest = 0;
  MPI_Recv(&rest, 1, MPI_INT64_T, from, sizes_tag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
  std::string bytes(size_t(rest), '\0');
  for (char* to = bytes.data(); rest > 0;) {
    const std::int64_t count = std::min(rest, most_at_once);
    MPI_Recv(to, int(count), MPI_BYTE, from, bytes_tag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
    to += count, rest -= count;
  }
  return bytes;
}

tokid::Team world() {
  int rank = 0, size = 1;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  tokid::Team team{rank, size, {}, {}};
  team.broadcast = [rank, size](std::string own) {
    if (rank > 0) return receive(0);
    for (int other = 1; other < size; ++other) send(own, other);
    return own;
  };
  team.gather = [rank, size](std::string own) {
    std::vector<std::string> all;
    if (rank > 0) {
      send(own, 0);
      return all;
    }
    all.push_back(std::move(own));
    for (int other = 1; other < size; ++other) all.push_back(receive(other));
    return all;
  };
  return team;
}

bool for_all(int argc, char** argv) {
  const std::string_view command = argc > 1 ? argv[1] : "";
  const bool asks = std::any_of(argv + 1, argv + argc, [](const char* a) {
    return a == std::string_view("--help") || a == std::string_view("-h");
  });
  return !asks && (command == "identify" || command == "update");
}

}  // namespace

int main(int argc, char** argv) {
  // All threads compute and read, but only the first thread sends.
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  tokid::Team& team = tokid::app::team();
  team = world();
  tokid::app::Outcome outcome;
  if (team.rank == 0 || for_all(argc, argv)) outcome = tokid::app::run_tool(argc, argv);
  if (outcome.status != 0) {
    // If all processes have the same error, the first process reports it and ends the others, which wait before they
    // report.
    if (team.rank > 0) std::this_thread::sleep_for(std::chrono::milliseconds(2000 + 100 * team.rank));
    tokid::app::message(team.rank == 0 ? outcome.complaint
                                       : fmt::format("process {}: {}", team.rank, outcome.complaint));
    MPI_Abort(MPI_COMM_WORLD, outcome.status);
  }
  MPI_Finalize();
  return 0;
}
