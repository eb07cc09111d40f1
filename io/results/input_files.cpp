#include "input_files.h"

#include "../../models/rig/numbers.h"
#include "../document/files.h"
#include "csv.h"
#include "result_json.h"
#include "scene_json.h"

namespace kincal {
namespace {

/// The rig as it is: a report of nothing that was estimated.
Report as_it_is(const std::shared_ptr<const Recording>& recording) {
  Report out;
  out.solution.recording = recording;
  out.solution.initial = out.solution.values.shared = recording->table.initial;
  return out;
}

/// The measurements alone, without predictions.
std::vector<ViewResiduals> measured(const Recording& recording) {
  std::vector<ViewResiduals> out;
  for (size_t i = 0; i < recording.samples.size(); ++i)
    for (const View& view : recording.samples[i].views) {
      const SensorModel& model = *recording.rig.sensors[view.sensor].model;
      const int blocks = model.blocks(static_cast<int>(view.ids.size()));
      const VectorXd unknown = VectorXd::Constant(blocks * model.rows(), kNan);
      out.push_back({&view, static_cast<int>(i), unknown, unknown});
    }
  return out;
}

}  // namespace

ResultFiles page_files(const char* kind, const RigFile& rig_file, const ResultOptions& record,
                       const Report& report, const Json& found) {
  Json json = {{"kind", kind},
               {"kincal", record.version},
               {"input",
                {{"command", record.command},
                 {"date", record.date},
                 {"rig", sha256(rig_file.text)},
                 {"samples", record.samples_hash},
                 {"urdf", sha256(rig_file.urdf.text)}}}};
  if (!rig_file.serial.empty()) json["serial"] = rig_file.serial;
  if (!rig_file.time.empty()) json["time"] = rig_file.time;
  json.update(found);
  json["scene"] = scene_json(report, rig_file.urdf);
  ResultFiles out;
  out.result_json = json_text(json);
  out.samples_csv = samples_csv(report.solution);
  out.residuals_csv = residuals_csv(report);
  return out;
}

ResultFiles evaluation_files(const RigFile& rig_file,
                             const std::shared_ptr<const Recording>& recording,
                             const Evaluation& evaluation, const Notices& warnings,
                             const ResultOptions& record) {
  Report report = as_it_is(recording);
  report.residuals.after = evaluation.views;
  return page_files("evaluation", rig_file, record, report, evaluation_json(evaluation, warnings));
}

ResultFiles check_files(const RigFile& rig_file, const std::shared_ptr<const Recording>& recording,
                        const Diagnosis& diagnosis, bool explained, const ResultOptions& record) {
  Report report = as_it_is(recording);
  report.residuals.after = measured(*recording);
  Json found = diagnosis_json(diagnosis);
  found["said"] = found["verdict"];
  found.erase("verdict");
  found["explained"] = explained;
  return page_files("check", rig_file, record, report, found);
}

}  // namespace kincal
