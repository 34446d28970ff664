function [file, files] = model_to_write(folder, data, files)
% The temporary file for a new model: .h5 beside an .h5, which may be too large for memory, else .mat.

% SPDX-License-Identifier: BSD-3-Clause

[~, ~, extension] = fileparts(data);
if any(strcmpi(extension, {'.h5', '.hdf5'}))
  file = fullfile(folder, 'new_model.h5');
else
  file = fullfile(folder, 'new_model.mat');
end
files(end + 1, :) = {file, 'model'};
end
