% Identifies time-invariant models of ensembles by n4sid of the control package.
%
% REQUESTS, a .mat, has `ensembles`, a cell of structs with u (N x T x r) and y (N x T x m). The rows of its `fits` are
% the number of an ensemble, an order, and a number of block rows. ANSWERS, another .mat, has a struct for each fit: A,
% B, C, D, the Kalman gain K and processor seconds; nothing but the seconds where n4sid fails. The versions stand beside.

% SPDX-License-Identifier: BSD-3-Clause

1;  % a script

function records = by_experiment(samples)
  records = cell(size(samples, 1), 1);
  for i = 1:numel(records)
    records{i} = reshape(samples(i, :, :), size(samples, 2), []);
  end
end

pkg load control
warning('off', 'all');  % of n4sid, about the choice of block rows
given = load(getenv('REQUESTS'));
data = cellfun(@(e) iddata(by_experiment(e.y), by_experiment(e.u), 1), given.ensembles, 'UniformOutput', false);
answers = cell(rows(given.fits), 1);
for i = 1:rows(given.fits)
  fit = given.fits(i, :);
  begin = cputime();
  try
    [model, ~, info] = n4sid(data{fit(1)}, fit(2), 's', fit(3), 'alg', 'Q');
    found = struct('A', model.a, 'B', model.b, 'C', model.c, 'D', model.d, 'K', info.K);
  catch
    found = struct();  % too few steps for so many block rows, or no gain
  end
  found.seconds = cputime() - begin;
  answers{i} = found;
end
versions = struct('octave', version(), 'control', ver('control').Version);
save('-v7', getenv('ANSWERS'), 'answers', 'versions');
