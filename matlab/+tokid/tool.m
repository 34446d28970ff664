function path = tool(path)
% TOKID.TOOL  The command line tool that the functions of this package call.
%
%   tokid.tool('/opt/tokid/bin/tokid')   takes this one from now on; tokid.tool('') looks for one again
%   path = tokid.tool()                  tells which one is taken
%
% Looked for in this order: what was set here; the environment variable TOKID; the tool that was installed or built with
% these files; the folders of PATH. A relative path is taken from the folder that is the current one when it is first
% seen. Errors: tokid:toolNotFound.

% SPDX-License-Identifier: BSD-3-Clause

persistent chosen found told resolved
if nargin > 0
  if isempty(path) || (isa(path, 'string') && all(strlength(path) == 0))
    path = '';
  else
    path = tokid.internal.absolute(tokid.internal.file_name(path));
    if ~is_file(path)
      error('tokid:toolNotFound', '%s: no such file', path);
    end
  end
  chosen = path;
  found = '';
  told = '';
  if isempty(chosen)
    return
  end
end
if ~isempty(chosen)
  path = chosen;
  return
end
named = getenv('TOKID');
if ~isempty(named)
  if ~strcmp(named, told)
    resolved = tokid.internal.absolute(named);
    told = named;
  end
  if ~is_file(resolved)
    told = '';
    error('tokid:toolNotFound', '%s: no such file; the environment variable TOKID should hold the path of the tool', ...
          named);
  end
  path = resolved;
  return
end
if isempty(found) || ~is_file(found)
  found = search();
end
path = found;
end

function path = search()
name = 'tokid';
if ispc()
  name = 'tokid.exe';
end
here = fileparts(fileparts(mfilename('fullpath'))); % the folder of +tokid
folders = [{fullfile(fileparts(fileparts(fileparts(here))), 'bin'), fullfile(fileparts(here), 'build', 'bin')}, ...
           strsplit(getenv('PATH'), pathsep())];
for i = 1:numel(folders)
  path = tokid.internal.absolute(fullfile(folders{i}, name));
  if ~isempty(folders{i}) && is_file(path)
    return
  end
end
error('tokid:toolNotFound', ['the program tokid was not found on PATH; install it, or say where it is by ' ...
                             'tokid.tool(''path''), or by the environment variable TOKID']);
end

function yes = is_file(path)
yes = exist(path, 'file') == 2;
end
