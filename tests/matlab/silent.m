function varargout = silent(f)
% [...] = silent(f): what f() gives; it must end without a warning.

% SPDX-License-Identifier: BSD-3-Clause

lastwarn('', '');
[varargout{1:nargout}] = f();
assert(isempty(lastwarn()), 'warning: %s', lastwarn());
end
