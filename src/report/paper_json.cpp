// Writes the figures and the numbers of the paper's example as JSON, for the page and for other programs.
// SPDX-License-Identifier: BSD-3-Clause
#include "base/json.hpp"
#include "report/paper_figures.hpp"
#include "tokid/report.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace report {

namespace {

Json series_json(const Series& s) {
  return {{"name", s.name}, {"mark", to_string(s.mark)}, {"colour", s.colour}, {"x", s.x}, {"y", s.y}};
}

template <class Part>
Json list_json(const std::vector<Part>& parts, Json (*json)(const Part&)) {
  Json result = Json::array();
  for (const Part& part : parts) result.push_back(json(part));
  return result;
}

Json panel_json(const Panel& panel) {
  return {{"x_label", panel.x.label},
          {"y_label", panel.y.label},
          {"y_log", panel.y.log},
          {"y_range", panel.y.range ? Json(*panel.y.range) : Json()},
          {"complex_plane", panel.complex_plane},
          {"series", list_json(panel.series, series_json)}};
}

Json figure_json(const Figure& figure) {
  return {{"id", figure.id},
          {"title", figure.title},
          {"caption", figure.caption},
          {"panels", list_json(figure.panels, panel_json)}};
}

Json complex_json(std::complex<double> value) { return {value.real(), value.imag()}; }

Json printed_json(const PrintedNumber& n) {
  return {{"equation", n.equation},
          {"quantity", n.quantity},
          {"printed", complex_json(n.printed)},
          {"computed", complex_json(n.computed)},
          {"tolerance", n.tolerance},
          {"agrees", n.agrees()}};
}

Json case_json(const PaperCase& one) {
  return {{"experiments", one.experiments}, {"condition_max", one.condition_max}};
}

Json cell_json(const KalmanStudyCell& cell) {
  return {{"lags", cell.lags},
          {"experiments", cell.experiments > 0 ? Json(cell.experiments) : Json()},
          {"error", cell.error},
          {"gain", cell.gain}};
}

Json study_json(const KalmanStudy& study) {
  const KalmanStudyOptions& o = study.options;
  return {{"process_noise", o.process_noise},
          {"measurement_noise", o.measurement_noise},
          {"steps", o.steps},
          {"begin", o.begin},
          {"end", o.end},
          {"fresh", o.fresh},
          {"kalman_error", study.kalman_error},
          {"cells", list_json(study.cells, cell_json)}};
}

}  // namespace

}  // namespace report

std::string paper_json(const Paper& paper, const KalmanStudy& study) {
  using namespace report;
  const Json json = {{"version", version},
                     {"dt", paper.system.dt},
                     {"steps", paper.system.steps()},
                     {"lags", paper.lags},
                     {"case_1", case_json(paper.minimum)},
                     {"case_2", case_json(paper.more)},
                     {"figures", list_json(paper_figures(paper, study), figure_json)},
                     {"similarity", paper.similarity},
                     {"appendix_b", list_json(paper.printed, printed_json)},
                     {"closed_loop_products", paper.products},
                     {"kalman_study", study_json(study)}};
  return text_of(json, 1) + "\n";
}

}  // namespace tokid
