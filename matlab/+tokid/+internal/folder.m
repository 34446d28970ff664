function [folder, clean] = folder()
% [folder, clean] = tokid.internal.folder() makes a folder for the files of one call, which is removed when `clean` goes
% out of scope, also by an error or Ctrl-C.

% SPDX-License-Identifier: BSD-3-Clause

for attempt = 1:100
  folder = tempname();
  [made, message] = private_folder(folder);
  if made && isempty(message) % with a message it was there before, and is not ours
    clean = onCleanup(@() remove(folder));
    return
  end
end
error('tokid:folder', '%s: no folder can be made for temporary files: %s', folder, message);
end

function [made, message] = private_folder(folder)
% Others on the machine have no business with the data.
if tokid.internal.is_octave()
  before = feval('umask', 77);
  restore = onCleanup(@() feval('umask', before));
  [made, message] = mkdir(folder);
else
  [made, message] = mkdir(folder);
  if made && isempty(message) && ~ispc()
    [~, ~] = fileattrib(folder, '-r -w -x', 'g');
    [~, ~] = fileattrib(folder, '-r -w -x', 'o');
  end
end
end

function remove(folder)
entries = dir(folder);
for i = 1:numel(entries)
  if ~entries(i).isdir
    file = fullfile(folder, entries(i).name);
    if tokid.internal.is_octave()
      feval('unlink', file); % delete() would take the name for a pattern
    else
      delete(file);
    end
  end
end
rmdir(folder);
end
