% Identifies the record of DATA, a .mat with u (T x r), y (T x m), order and repetitions, by n4sid of the control package,
% and writes A, B, C, D, the Kalman gain K, the processor and wall seconds of each repetition and the versions to ANSWER.

% SPDX-License-Identifier: BSD-3-Clause

pkg load control
warning('off', 'all');
given = load(getenv('DATA'));
data = iddata(given.y, given.u, 1);
[~, ~, ~] = n4sid(data, given.order);  % what Octave loads at the first call
for i = 1:given.repetitions
  clock = tic;
  begin = cputime();
  [model, ~, info] = n4sid(data, given.order);
  cpu(i) = cputime() - begin;
  wall(i) = toc(clock);
end
[A, B, C, D] = ssdata(model);
K = info.K;
versions = struct('octave', version(), 'control', ver('control').Version);
save('-v7', getenv('ANSWER'), 'A', 'B', 'C', 'D', 'K', 'cpu', 'wall', 'versions');
