function need(found, varargin)
% tokid.internal.need(nargin, 'model', 'u') complains where an argument is missing. Errors: tokid:input.

% SPDX-License-Identifier: BSD-3-Clause

if found < numel(varargin)
  error('tokid:input', '%s: none found, the arguments are (%s, ...)', varargin{found + 1}, strjoin(varargin, ', '));
end
end
