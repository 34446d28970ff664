function [file, files] = take_model(folder, model, name)
% [file, files] = tokid.internal.take_model(folder, model, name) gives the file of a model for the tool: one given by its
% name, or a temporary one, which messages call by `name` (default 'model'). `files`: as tokid.internal.call has it.

% SPDX-License-Identifier: BSD-3-Clause

if ischar(model) || isa(model, 'string')
  file = tokid.internal.file_name(model);
  files = cell(0, 2);
else
  if nargin < 3
    name = 'model';
  end
  file = fullfile(folder, [name, '.mat']);
  files = {file, name};
  tokid.internal.write_model(file, model);
end
end
