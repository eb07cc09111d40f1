// kincal inside another program: files in, calibration, geometry out. Usage: embed rig.yaml
// samples.jsonl
#include <kincal/files.h>
#include <kincal/kincal.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: embed rig.yaml samples.jsonl\n");
    return 1;
  }
  try {
    const kincal::RigFile file = kincal::read_rig(argv[1]);

    kincal::StudyOptions options;
    options.calibration.progress = kincal::Progress(
        [](const kincal::Progress::News& news) { return news.iteration < 100; });  // false cancels
    const std::optional<kincal::Report> report = kincal::study(
        kincal::make_recording(file.rig, kincal::read_samples(argv[2], file.rig)), options);
    if (!report) {
      std::printf("cancelled\n");
      return 1;
    }
    const kincal::Solution& solution = report->solution;
    if (!solution.message.empty()) std::fprintf(stderr, "%s\n", solution.message.c_str());
    std::printf("chi2 %.17g dof %ld\n", solution.chi2, solution.dof);
    for (const kincal::ParameterEstimate& p : solution.parameters)
      for (size_t i = 0; i < p.value.size(); ++i)
        std::printf("parameter %s%s%s %.17g %.17g\n", p.name.c_str(),
                    p.components[i].empty() ? "" : ".", p.components[i].c_str(), p.value[i],
                    p.sigma[i]);
    for (const kincal::SensorResult& s : report->residuals.sensors)
      std::printf("sensor %s %.17g %s, held out %.17g\n", s.name.c_str(), s.train.rms,
                  s.unit.c_str(), s.test.rms);
    for (const kincal::Notice& w : report->warnings)
      std::printf("warning %s: %s\n", kincal::id(w.kind), kincal::sentences(w).c_str());
    return solution.status == kincal::Status::converged ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
