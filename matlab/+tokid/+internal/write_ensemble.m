function write_ensemble(file, data)
% Writes an ensemble out of tokid.internal.ensemble. `experiments` says that N x T is one channel of N experiments.

% SPDX-License-Identifier: BSD-3-Clause

data.experiments = size(data.u, 1);
tokid.internal.write_mat(file, data);
end
