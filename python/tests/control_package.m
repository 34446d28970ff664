% What the control package of Octave identifies from the ensembles of REQUESTS, a .mat, into ANSWERS, another.
%
% A request has u (N x T x r), y (N x T x m), the name of a function, and the order that it is given. An answer has A, B,
% C, D and the Kalman gain K of n4sid; or the coefficients of arx, newest lag first: those of the outputs, then those of
% each input.

% SPDX-License-Identifier: BSD-3-Clause

1;  % a script

function records = by_experiment(samples)
  records = cell(size(samples, 1), 1);
  for i = 1:numel(records)
    records{i} = reshape(samples(i, :, :), size(samples, 2), []);
  end
end

function answer = by_n4sid(request)
  % The QR algorithm: the default, of Cholesky factors, has half of the digits, and fails without noise.
  data = iddata(by_experiment(request.y), by_experiment(request.u), 1);
  [model, ~, info] = n4sid(data, request.order, 'alg', 'Q');
  answer = struct('A', model.a, 'B', model.b, 'C', model.c, 'D', model.d, 'K', info.K);
end

function answer = by_arx(request)
  % arx knows no direct feedthrough. Inputs that come a step earlier make one; no equation has the first output.
  late = @(x, value) [repmat(value, 1, columns(x)); x];
  y = cellfun(@(x) late(x, 0), by_experiment(request.y), 'UniformOutput', false);
  u = cellfun(@(x) [x; zeros(1, columns(x))], by_experiment(request.u), 'UniformOutput', false);
  model = arx(iddata(y, u, 1), 'na', request.order, 'nb', request.order + 1);
  [b, a] = filtdata(model);
  inputs = cellfun(@(x) x(2:end), b(1:columns(u{1})), 'UniformOutput', false);
  answer = struct('coefficients', [-a{1}(2:end), inputs{:}]);
end

pkg load control
warning('off', 'all');  % of n4sid, that there is no noise
requests = load(getenv('REQUESTS')).requests;
answers = cellfun(@(request) feval(['by_', request.method], request), requests, 'UniformOutput', false);
versions = struct('octave', version(), 'control', ver('control').Version);
save('-v7', getenv('ANSWERS'), 'answers', 'versions');
