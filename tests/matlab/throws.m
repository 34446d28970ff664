function throws(identifier, part, f)
% throws(identifier, part, f): does f() end in an error of this identifier, with this text somewhere in its message?

% SPDX-License-Identifier: BSD-3-Clause

try
  f();
catch problem
  assert(strcmp(problem.identifier, identifier) && ~isempty(strfind(problem.message, part)), ...
         'identifier %s: %s', problem.identifier, problem.message); %#ok<STREMP>
  return
end
error('no error, %s expected: %s', identifier, part);
end
