function [file, files] = take_model(folder, model)
% [file, files] = tokid.internal.take_model(folder, model) gives the file of a model for the tool: one given by its
% name, or a temporary one. `files`: as tokid.internal.call has it.

% SPDX-License-Identifier: BSD-3-Clause

if ischar(model) || isa(model, 'string')
  file = tokid.internal.file_name(model);
  files = cell(0, 2);
else
  file = fullfile(folder, 'model.mat');
  files = {file, 'model'};
  tokid.internal.write_model(file, model);
end
end
