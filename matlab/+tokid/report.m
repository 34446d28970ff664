function evidence = report(page, model, varargin)
% TOKID.REPORT  A page (HTML) that shows whether a model can be trusted.
%
%   tokid.report('page.html', model, u, y)
%   evidence = tokid.report('page.html', model, data, 'horizon', 10)
%   tokid.report('page.html', 'model.npz', 'fresh.npz', 'compare', {'first.npz', 'second.npz'})
%
% The page is one file that loads nothing; docs/tutorial.md shows what is on it. The evidence is what
% 'tokid report --json' prints: trust, summary, reasons, checks and more (docs/formats.md). What can be said of data:
% see tokid.ensemble. Options:
%   'horizon'             steps ahead of the multi-step fit (default 10)
%   'from'                first step of the fits (default 0)
%   'experiments'         experiments in the plots, at most (default 24)
%   'at'                  steps of the responses (default steps at even distances): [0 20 50]
%   'bands'               experiments of the identification, for 95 % bands of the responses: a struct of
%                         tokid.ensemble, an iddata object or the name of a file
%   'compare'             another model, or a cell of several, to compare on the page: structs or names of files
%   'compare_names'       names of the models on the page: a cell of the names of model and all others, or of all
%                         others. The page shows them with the ending .mat, and '_' in place of / and other characters
%                         that names of files can't have
%   'inputs', 'outputs'   columns of a .csv
%
% Warnings have the identifier tokid:report; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'page', 'model');
known = {'horizon', 'value'; 'from', 'value'; 'experiments', 'value'; 'at', 'list'; 'bands', 'own'; 'compare', 'own'; ...
         'compare_names', 'own'; 'inputs', 'list'; 'outputs', 'list'};
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, of_model] = tokid.internal.take_model(folder, model);
[data, pairs, files] = tokid.internal.take_data(folder, true, varargin, model, {});
[words, own] = tokid.internal.options('report', known, pairs, tokid.internal.data_fields());
others = {};
if isfield(own, 'compare')
  others = own.compare;
end
if isa(others, 'string')
  others = cellstr(others);
elseif ~iscell(others)
  others = {others};
end
names = labels(own, numel(others));
[named_folder, clean_named] = tokid.internal.folder(); %#ok<ASGLU>
if isfield(own, 'compare_names') && ~isempty(names{1})
  [file, of_model] = named_model(named_folder, model, names{1});
end
for i = 1:numel(others)
  if isfield(own, 'compare_names')
    [other, of_other] = named_model(named_folder, others{i}, names{i + 1});
  else
    [other, of_other] = tokid.internal.take_model(folder, others{i}, sprintf('other_%d', i));
  end
  words = [words, {'--compare', other}]; %#ok<AGROW>
  files = [files; of_other]; %#ok<AGROW>
end
if isfield(own, 'bands')
  [training, of_training] = training_file(folder, own.bands, model);
  words = [words, {'--bands', training}];
  files = [files; of_training];
end
words = [{'report', file, data, '-o', tokid.internal.file_name(page), '--json'}, words];
output = tokid.internal.call(words, folder, [of_model; files]);
if nargout > 0
  evidence = tokid.internal.decode(output, folder);
end
end

function names = labels(own, others)
% The names of the model and of the others; '' where the model has none.
names = {};
if ~isfield(own, 'compare_names')
  return
end
given = own.compare_names;
if ~(ischar(given) || iscellstr(given) || isa(given, 'string'))
  error('tokid:option', 'report: option ''compare_names'': a value of class %s found, a cell of texts needed', ...
        class(given));
end
names = reshape(cellstr(given), 1, []);
if others == 0 || ~any(numel(names) == [others, others + 1])
  error('tokid:option', ['report: option ''compare_names'': %d names found beside %d models in ''compare'', one for ' ...
                         'each of them needed, or also one for the model before these'], numel(names), others);
end
files = regexprep(names, '[/\\:*?"<>|\x01-\x1f]', '_'); % the page shows names of files
if any(cellfun(@isempty, names)) || numel(unique(files)) < numel(names)
  error('tokid:option', 'report: option ''compare_names'': an empty name or equal names found, different ones needed');
end
names = files;
if numel(names) == others
  names = [{''}, names];
end
end

function [file, files] = named_model(folder, model, name)
% The model in a file of this name.
if ~isstruct(model)
  model = tokid.read(model);
end
[file, files] = tokid.internal.take_model(folder, model, name);
end

function [file, files] = training_file(folder, data, model)
if ischar(data) || isa(data, 'string')
  file = tokid.internal.file_name(data);
  files = cell(0, 2);
  return
end
if isa(data, 'iddata')
  data = tokid.internal.of_iddata(data);
end
data = tokid.internal.ensemble(data, true);
if ~isfield(data, 'dt') && isstruct(model) && isfield(model, 'dt')
  data.dt = model.dt;
end
file = fullfile(folder, 'bands.mat');
files = {file, 'bands'};
tokid.internal.write_ensemble(file, data);
end
