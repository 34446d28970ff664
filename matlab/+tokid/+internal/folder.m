function [folder, clean] = folder()
% [folder, clean] = tokid.internal.folder() makes a folder for the files of one call, with a folder 'models' in it. They
% are removed when `clean` goes out of scope, also by an error or Ctrl-C.

% SPDX-License-Identifier: BSD-3-Clause

folder = tempname();
[made, message] = private_folder(folder);
if ~made || ~isempty(message) % with a message it was there before, and is not ours
  error('tokid:folder', '%s: no folder can be made for temporary files: %s', folder, message);
end
clean = onCleanup(@() remove(folder));
mkdir(folder, 'models');
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
if tokid.internal.is_octave()
  before = feval('confirm_recursive_rmdir', false);
  restore = onCleanup(@() feval('confirm_recursive_rmdir', before));
end
rmdir(folder, 's');
end
