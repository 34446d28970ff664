function values = as_cells(values, lengths)
% N x T x channels as N cells of T_i x channels, if the experiments have lengths.

% SPDX-License-Identifier: BSD-3-Clause

if ~isempty(lengths)
  values = arrayfun(@(i) reshape(values(i, 1:lengths(i), :), lengths(i), size(values, 3)), (1:numel(lengths))', ...
                    'UniformOutput', false);
end
end
