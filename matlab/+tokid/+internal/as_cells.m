function cells = as_cells(values, lengths)
% N x T x channels as N cells of T_i x channels.

% SPDX-License-Identifier: BSD-3-Clause

cells = cell(numel(lengths), 1);
for i = 1:numel(lengths)
  cells{i} = reshape(values(i, 1:lengths(i), :), lengths(i), size(values, 3));
end
end
