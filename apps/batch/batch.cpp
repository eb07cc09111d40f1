#include "batch.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <optional>
#include <vector>

#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/job/require.h"
#include "../../io/report/report_page.h"
#include "../../io/results/comparison.h"
#include "../../io/results/summary_file.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/batch_table.h"
#include "batch_progress.h"
#include "child.h"
#include "on_slurm.h"
#include "output.h"
#include "sets.h"
#include "work.h"

namespace kincal {
namespace {

namespace fs = std::filesystem;

/// What a set's rig lacks of an option's value; "": it has it. @throws InputError where the rig
/// cannot be read.
std::string lacks(const Set& set, const std::string& option, const std::string& value) {
  Rig rig = read_rig(rig_path(set.rig)).rig;
  if (option == "--step") {
    std::vector<std::string> names;
    std::string known;
    for (const Step& step : rig.steps) {
      names.push_back(step.name);
      known += (known.empty() ? "" : ", ") + step.name;
    }
    if (std::count(names.begin(), names.end(), value)) return "";
    return "--step: there is no step '" + value + "' in any set" + nearest_names(value, names) +
           "; " + set.name + " has " + known;
  }
  if (option == "--group" || option == "--no-group") try {
      CalibrateSettings of_groups;
      (option == "--group" ? of_groups.groups : of_groups.no_groups) = {value};
      check_groups(rig, of_groups);
      ProgressLine silent(true);
      automatic_groups(read_job(set.rig, set.samples, {}, silent), of_groups);
      return "";
    } catch (const InputError& error) {
      return error.what();
    }
  const Recording recording(std::move(rig), {});
  if (option == "--require" || option == "--report-frame") try {
      if (option == "--require") parse_requirement(value, recording, Words::switches);
      if (option == "--report-frame") frame_named(recording.rig, recording.table, value, option);
      return "";
    } catch (const InputError& error) {
      return error.what();
    } catch (const NameError& error) {
      return with_nearest(error, Words::switches).what();
    }
  if (!recording.table.select(value).empty()) return "";
  return option + ": '" + value + "' matches no parameter in any set" +
         nearest_names(value, recording.table.names());
}

/// What an option names that no set has is reported once, before anything runs. Sets that cannot be
/// read are reported later.
/// @throws InputError
void check_names(const Sets& sets, const CalibrateSettings& settings) {
  std::vector<std::pair<std::string, std::string>> wanted;  // option, value
  if (!settings.step.empty()) wanted.push_back({"--step", settings.step});
  const auto add = [&](const char* option, const std::vector<std::string>& values) {
    for (const std::string& value : values) wanted.push_back({option, value});
  };
  add("--free", settings.free);
  add("--fix", settings.fix);
  add("--group", settings.groups);
  add("--no-group", settings.no_groups);
  add("--report-frame", settings.report_frames);
  add("--require", settings.require);
  for (const auto& [option, value] : wanted) {
    std::string wrong;
    bool found = false;
    for (size_t i = 0; i < sets.all.size() && !found; ++i) try {
        const std::string why = lacks(sets.all[i], option, value);
        found = why.empty();
        if (wrong.empty()) wrong = why;
      } catch (const InputError&) {
      }
    if (!found && !wrong.empty()) throw InputError(wrong);
  }
}

/// Calibrates what is to be done here. Returns false if it was interrupted.
bool calibrate_here(Work& work, const BatchArguments& a, BatchProgress& progress) {
  std::vector<Set> todo;
  for (const size_t i : work.todo) todo.push_back(work.sets[i]);
  return calibrate_each(
      todo, work.output, a, Signals(),
      [&](size_t i, SetSummary summary) {
        work.finish(work.todo[i], std::move(summary), progress);
      },
      [&] { progress.update(work.finished, work.failing); });
}

/// The sets for the page that shows them all. Of a set without a result the error takes its place.
std::vector<OverviewEntry> overview(const std::vector<SetSummary>& sets, const Output& output) {
  std::vector<OverviewEntry> out;
  for (const SetSummary& set : sets) {
    const std::string folder = output.result(set.name).string();
    if (set.status == "failed")
      out.push_back({set.name, failed_result(set.error), ""});
    else
      out.push_back({set.name, read_file(folder + "/result.json"),
                     file_exists(folder + "/report.html") ? set.name + "/report.html" : ""});
  }
  return out;
}

}  // namespace

int batch(const BatchArguments& a) {
  if (const char* token = task_token()) return run_task(a, token);
  std::error_code ignored;
  if (a.slurm.use) check_slurm(a.slurm);
  const Sets sets =
      fs::is_directory(a.sets, ignored) ? sets_of_folder(a.sets, a.out) : sets_of_list(a.sets);
  check_names(sets, a.settings);
  const Output output = open_output(a.out);
  const std::string options = options_text(a.settings), count = plural(sets.all.size(), "set");
  const bool silent = a.quiet || a.json;
  if (!goes_on_slurm(output, a, options)) output.tidy();

  Work work = find_work(sets.all, output, options);
  BatchProgress progress(silent, work.todo.size());
  size_t before = 0;
  for (const SetSummary& s : work.summaries) {
    if (s.status.empty()) continue;
    if (s.status != "failed") ++before;
    if (s.fails()) progress.say(failing_text(s));
  }
  if (!silent)
    progress.say(count + (before > 0 ? ", " + std::to_string(before) + " done before" : "") +
                 (work.redone.empty() ? ""
                                      : ", " + std::to_string(work.redone.size()) +
                                            " again: " + some(work.redone, 5)));

  // The summary is there only when the batch is done.
  const std::string csv = (output.folder / "summary.csv").string(),
                    json = (output.folder / "summary.json").string(),
                    page = (output.folder / "report.html").string();
  if (!work.todo.empty())
    for (const std::string& path : {csv, json, page}) fs::remove(path, ignored);
  for (const std::string& path : {csv, json, page}) say_cleared(clear_leftovers(path));
  if (a.slurm.use) {
    if (const std::optional<int> code = calibrate_on_slurm(work, a, options, progress))
      return *code;
  } else if (!calibrate_here(work, a, progress)) {
    output.clean();
    progress.end();
    std::fprintf(stderr, "kincal: interrupted; %zu of %s done, the same command goes on\n",
                 work.sets_done(), count.c_str());
    return kInterrupted;
  }
  output.clean();

  const std::string text = summary_json(work.summaries, KINCAL_VERSION, options, sets.ignored);
  write_file(csv, summary_csv(work.summaries), true);
  write_file(json, text, true);
  if (!a.settings.no_report)
    write_file(page, overview_page(overview(work.summaries, output)), true);
  if (a.json)
    std::cout << text;
  else if (!a.quiet)
    std::cout << batch_table(work.summaries, sets.ignored) << "\nWritten to " << a.out
              << (a.settings.no_report ? ": summary.csv, summary.json and a folder for each set\n"
                                       : ": report.html shows all sets; summary.csv, summary.json "
                                         "and a folder for each\n");
  const std::vector<std::string> left = results_without_set(sets.all, output);
  if (!left.empty() && !silent)
    std::fprintf(
        stderr, "kincal: %s also has %s of no set of this batch, which `kincal fleet` counts: %s\n",
        a.out.c_str(), plural(left.size(), "result").c_str(), some(left, 10).c_str());
  std::vector<std::string> names;
  for (const SetSummary& s : work.summaries)
    if (s.fails()) names.push_back(s.name);
  if (names.empty()) return kConverged;
  std::fprintf(stderr, "kincal: error: %zu of %s failed: %s\n", names.size(), count.c_str(),
               some(names, 100).c_str());
  return kBadInput;
}

}  // namespace kincal
