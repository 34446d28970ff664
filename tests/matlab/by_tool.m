function contents = by_tool(varargin)
% contents = by_tool('simulate', 'model.npz', ..., 'out.mat'): what the tool itself writes into the last file, which
% must be a .mat. Names without blanks only.

% SPDX-License-Identifier: BSD-3-Clause

words = varargin;
if ~strcmp(words{1}, 'convert')
  words = [words(1:end - 1), {'-o'}, words(end)];
end
[status, output] = system(['"', getenv('TOKID'), '" ', strjoin(words, ' '), ' 2>&1']);
assert(status == 0, '%s', output);
contents = load(varargin{end});
end
