// `kincal verify`: is a calibrated robot as accurate as is claimed?
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/job/certificate.h"
#include "../../io/job/verify.h"
#include "../../io/report/certificate.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

constexpr int kNotProvable = 5;

struct VerifyArguments {
  std::string result, samples, out;
  VerifySettings settings;
  bool json = false, force = false, quiet = false;
};

int verify_result(const VerifyArguments& a) {
  if (!a.out.empty() && file_exists(a.out + "/result.json"))
    throw InputError(
        a.out +
        ": this directory has a calibration result, which would be deleted: choose another --out");
  if (!a.out.empty()) check_output(a.out, a.force);
  const VerifiedResult result = read_verified_result(a.result);
  ProgressLine line(a.quiet || a.json);
  const SampleSet samples = read_sample_set(a.samples, result.files.rig_file.rig, line);
  line.clear();
  const Verification found = verify(result, samples, a.settings);
  const std::string json = json_text(certificate_json(result, samples, found, a.settings));
  if (!a.out.empty()) {
    const std::string page = certificate_page(json);
    begin_writing();
    if (!write_directory(a.out, {{"certificate.html", page}, {"certificate.json", json}}, a.force,
                         not_interrupted))
      return say_interrupted();
  }
  if (a.json)
    std::cout << json;
  else if (!a.quiet) {
    std::cout << verification_text(found);
    if (!a.out.empty()) std::cout << "Certificate: " << a.out << "/certificate.html\n";
  }
  if (!found.tolerance || found.answer == Conformity::pass) return kConverged;
  return found.answer == Conformity::fail ? static_cast<int>(kToleranceNotMet) : kNotProvable;
}

}  // namespace

Command verify_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<VerifyArguments>();
  a->settings.command = command_line;
  CLI::App* command = app.add_subcommand(
      "verify", "Verify a calibrated robot with samples that its calibration did not use");
  command->add_option("RESULT", a->result, "a result directory, or its result.json")->required();
  command
      ->add_option("SAMPLES", a->samples,
                   "samples.jsonl of a measuring instrument: points or poses")
      ->required();
  command
      ->add_option("--tolerance", a->settings.tolerance,
                   "limit of the rms error of a measured frame: 'frame/target/NAME<0.3mm', "
                   "'frame/LINK<0.3mm', of rotations (iso9283) 'frame/LINK<0.05deg'; of the "
                   "largest error of the measured postures: 'max frame/LINK<0.8mm'")
      ->type_name("TOLERANCE");
  command
      ->add_option("--standard", a->settings.standard,
                   "compare distances between postures, or positions in the calibrated "
                   "frame of the instrument (iso9283)")
      ->check(CLI::IsMember(std::vector<std::string>{"distances", "iso9283"}))
      ->capture_default_str();
  command->add_flag("--refit-base", a->settings.refit_base,
                    "the instrument was set up anew: fit its pose to these samples");
  command
      ->add_option("--sensor", a->settings.sensor, "name of the instrument, if there are several")
      ->type_name("NAME");
  command->add_option("--out", a->out, "directory for certificate.html and certificate.json")
      ->type_name("DIR");
  command
      ->add_option("--instrument", a->settings.instrument,
                   "for the certificate: name of the instrument")
      ->type_name("TEXT");
  command
      ->add_option("--environment", a->settings.environment,
                   "for the certificate: conditions (temperature, load, ...)")
      ->type_name("TEXT");
  command
      ->add_option("--serial", a->settings.serial,
                   "for the certificate: serial number of the robot; default: the rig's")
      ->type_name("TEXT");
  command->add_option("--measured", a->settings.measured, "for the certificate: date")
      ->type_name("TEXT");
  command->add_flag("--json", a->json, "print certificate.json");
  command->add_flag("--force", a->force, "replace an existing directory");
  command->add_flag("--quiet", a->quiet, "print nothing");
  command->footer(
      "Exit codes: 0 pass, or no tolerance given; 1 bad input or usage, or samples that the "
      "calibration used; 4 fail; 5 not\n"
      "provable with this instrument and this number of postures; 130 interrupted, nothing "
      "written.");
  return {command, [a] { return verify_result(*a); }};
}

}  // namespace kincal
