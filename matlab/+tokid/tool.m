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

persistent chosen named resolved found
if nargin > 0
  if isempty(path) || (isa(path, 'string') && all(strlength(path) == 0))
    path = '';
  else
    path = existing(absolute(tokid.internal.file_name(path)), '');
  end
  [chosen, named, found] = deal(path, '', '');
end
if ~isempty(chosen) || nargin > 0
  path = chosen;
  return
end
if ~strcmp(getenv('TOKID'), named) || exist(resolved, 'file') ~= 2
  named = getenv('TOKID');
  resolved = absolute(named);
end
if ~isempty(named)
  path = existing(resolved, '; the environment variable TOKID should hold the path of the tool');
  return
end
if isempty(found) || exist(found, 'file') ~= 2
  found = search();
end
path = found;
end

function path = existing(path, advice)
if exist(path, 'file') ~= 2
  error('tokid:toolNotFound', '%s: no such file%s', path, advice);
end
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
  path = absolute(fullfile(folders{i}, name));
  if ~isempty(folders{i}) && exist(path, 'file') == 2
    return
  end
end
error('tokid:toolNotFound', ['the program tokid was not found on PATH; install it, or say where it is by ' ...
                             'tokid.tool(''path''), or by the environment variable TOKID']);
end

function file = absolute(file)
% The name of a file that stays good when the current folder changes.
if isempty(regexp(file, '^[\\/]', 'once')) && ~(ispc() && ~isempty(regexp(file, '^[A-Za-z]:[\\/]', 'once')))
  file = fullfile(pwd(), regexprep(file, '^(\./+)+', ''));
end
end
