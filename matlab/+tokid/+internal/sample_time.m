function dt = sample_time(folder, file, kind)
% dt = tokid.internal.sample_time(folder, file, kind) tells the sample time of a 'model' or a 'state' by its file; [] of
% a state that can't be read, which the tool will complain about.

% SPDX-License-Identifier: BSD-3-Clause

if strcmp(kind, 'model')
  output = tokid.internal.call({'info', file, '--json'}, folder, cell(0, 2));
  dt = getfield(tokid.internal.decode(output, folder), 'dt'); %#ok<GFLD>
  return
end
dt = [];
if ~is_hdf5(file)
  return
end
try
  if tokid.internal.is_octave()
    dt = getfield(load('-hdf5', file, 'dt'), 'dt'); % nothing else of the file, which may be large
  else
    dt = h5read(file, '/dt');
  end
catch
  dt = [];
end
end

function yes = is_hdf5(file)
% HDF5 itself would print what it finds wrong.
yes = false;
id = fopen(file, 'r');
if id >= 0
  yes = isequal(fread(id, 8, 'uint8')', [137, 72, 68, 70, 13, 10, 26, 10]);
  fclose(id);
end
end
