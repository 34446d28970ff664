function check_model(model, needed)
% Is this a model, with these fields? Errors: tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

if ~isstruct(model) || numel(model) ~= 1
  error('tokid:model', 'model: a value of class %s found, the struct of tokid.identify or tokid.read needed', ...
        class(model));
end
missing = needed(~isfield(model, needed));
if ~isempty(missing)
  error('tokid:model', 'model: the field %s is missing', strjoin(missing, ', '));
end
end
