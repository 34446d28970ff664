function varargout = warns(identifier, part, f)
% [...] = warns(identifier, part, f): what f() gives; its last warning must have this identifier and this text.

% SPDX-License-Identifier: BSD-3-Clause

lastwarn('', '');
[varargout{1:nargout}] = f();
[message, found] = lastwarn();
assert(strcmp(found, identifier) && ~isempty(strfind(message, part)), 'identifier %s: %s', found, message); %#ok<STREMP>
end
