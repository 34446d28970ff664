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
given = {'', 'model', 'model', model; '', 'data', 'data', []; '-o', 'file', 'page', page};
options = ['horizon from experiments at:list bands:data compare:own compare_names:own ' ...
           'inputs:list outputs:list'];
call = tokid.internal.take('report', given, options, varargin);
others = {};
if isfield(call.said, 'compare')
  others = call.said.compare;
end
if ~iscell(others)
  others = {others};
end
models = [{model}, others(:)'];
names = arrayfun(@(i) sprintf('other_%d', i), 0:numel(others), 'UniformOutput', false);
names{1} = 'model';
if isfield(call.said, 'compare_names')
  [names, models] = named(names, models, call.said.compare_names);
end
call.given(1, 3:4) = [names(1), models(1)];
for i = 2:numel(models)
  call.given(end + 1, :) = {'--compare', 'model', names{i}, models{i}};
end
found = tokid.internal.run(call);
if nargout > 0
  evidence = found;
end
end

function [names, models] = named(names, models, given)
% The models with the names that were given to them, or to all but the first.
if ~(ischar(given) || iscellstr(given))
  error('tokid:option', ['report: option ''compare_names'': a value of class %s found, ' ...
                         'a cell of texts needed'], class(given));
end
given = regexprep(cellstr(given), '[/\\:*?"<>|\x01-\x1f]', '_'); % the page shows names of files
others = numel(models) - 1;
if others == 0 || ~any(numel(given) == [others, others + 1])
  error('tokid:option', ['report: option ''compare_names'': %d names found beside %d models in ' ...
                         '''compare'', one for each of them needed, or also one for the model ' ...
                         'before these'], numel(given), others);
end
places = numel(models) - numel(given) + 1:numel(models);
names(places) = given;
if any(cellfun(@isempty, names)) || numel(unique(names)) < numel(names)
  error('tokid:option', ['report: option ''compare_names'': an empty name or equal names found, ' ...
                         'different ones needed']);
end
for i = places(~cellfun(@isstruct, models(places)))
  models{i} = tokid.read(models{i}); % to be written by its name
end
end
