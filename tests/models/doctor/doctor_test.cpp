// Parts of the doctor on small rigs whose answer is known. The planted mistakes on whole data sets
// are in check_test.py.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "../../../models/doctor/alternatives.h"
#include "../../../models/doctor/doctor.h"
#include "../../../models/doctor/hypotheses.h"
#include "../../../models/doctor/trial_fits.h"
#include "../../../models/rig/targets.h"
#include "../../../models/sensors/sensors.h"
#include "../../../models/simulation/simulation.h"

namespace kincal {
namespace {

Target board(int rows, int columns, int block = 1) {
  Target t;
  t.name = "board";
  t.type = block == 1 ? "chessboard" : "apriltag_grid";
  t.square = 0.05;
  t.layout.resize(3, rows * columns * block);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) t.layout.col(r * columns + c) << c, r, 0;
  return t;
}

Joint joint(const std::string& name, int parent, int child, JointType type, const Vector3d& axis,
            const Pose& origin) {
  Joint j;
  j.name = name;
  j.parent = parent;
  j.child = child;
  j.type = type;
  j.axis = axis;
  j.parent_T_joint = origin;
  return j;
}

/// Three revolute joints, a camera on the last link, a board on the base; both poses freed.
struct EyeInHand {
  Rig rig;
  std::vector<Sample> samples;

  explicit EyeInHand(int boards = 1, Lens lens = Lens::pinhole) {
    rig.tree.links = {"base", "one", "two", "hand"};
    rig.tree.joints = {joint("pan", 0, 1, JointType::revolute, Vector3d::UnitZ(),
                             {Matrix3d::Identity(), {0, 0, 0.3}}),
                       joint("lift", 1, 2, JointType::revolute, Vector3d::UnitY(),
                             {Matrix3d::Identity(), {0.1, 0, 0.2}}),
                       joint("roll", 2, 3, JointType::revolute, Vector3d::UnitX(),
                             {Matrix3d::Identity(), {0.3, 0.05, 0}})};
    finish_tree(rig.tree);
    rig.joints.resize(3);
    rig.targets = {board(5, 7)};
    rig.targets[0].link = 0;
    rig.targets[0].pose_given = true;
    Pose& pose = rig.targets[0].link_T_target;  // in front of the arm, its z axis away from it
    pose.rotation.col(0) = -Vector3d::UnitY();
    pose.rotation.col(1) = -Vector3d::UnitZ();
    pose.rotation.col(2) = Vector3d::UnitX();
    pose.translation << 1.3, 0.2, 0.7;
    for (int k = 1; k < boards; ++k) {  // beside it
      rig.targets.push_back(rig.targets[0]);
      rig.targets[k].name = "board" + std::to_string(k);
      rig.targets[k].link_T_target.translation += Vector3d(0, k % 2 ? 0.4 : -0.4, k > 2 ? 0.3 : 0);
    }
    Sensor camera;
    camera.name = "camera";
    camera.type = "camera";
    camera.link = 3;
    camera.pose_given = true;
    camera.link_T_sensor.rotation = rig.targets[0].link_T_target.rotation;
    camera.link_T_sensor.translation << 0.05, 0.02, 0.06;
    const std::vector<double> distortion(lens == Lens::pinhole ? 0 : 4, 0.0);
    camera.model = make_camera(lens, static_cast<int>(distortion.size()));
    camera.parameters = camera_parameters(lens, {400, 400, 320, 240}, distortion, 0);
    camera.sigma = {0.2, 0.2};
    camera.image_width = 640;
    camera.image_height = 480;
    rig.sensors = {camera};
    Step step;
    step.name = "all";
    step.sensors = {0};
    step.free = {"sensor/camera/pose", "target/*/pose"};
    rig.steps = {step};

    const ParameterTable table(rig);
    SimulationOptions options;
    options.seed = 3;
    options.samples = 16;
    for (int i = 0; i < 16; ++i) {
      Posture p;
      p.id = "p" + std::to_string(10 + i);
      p.readings = {0.25 * std::sin(1.3 * i), 0.2 * std::cos(2.1 * i), 0.5 * std::sin(0.7 * i + 1)};
      options.postures.push_back(p);
    }
    VectorXd truth = table.initial;
    set_pose(
        truth, table.all[table.sensor_pose[0]].start,
        camera.link_T_sensor * exp_se3((Vector6d() << 0.01, 0, 0.01, 0.02, 0.01, 0).finished()));
    samples = simulate(rig, table, truth, options).samples;
    REQUIRE(samples.size() >= 12);
  }

  Diagnosis check() const { return *diagnose(rig, samples, {}); }
};

std::vector<std::string> ids(const Diagnosis& d) {
  std::vector<std::string> out;
  for (const Notice& f : d.findings) out.emplace_back(id(f.kind));
  return out;
}
using Ids = std::vector<std::string>;

}  // namespace

TEST_CASE("hypotheses: relabelings of a grid") {
  const Target t = board(4, 5);
  Eigen::Matrix2d half = -Eigen::Matrix2d::Identity(), mirror = Eigen::Matrix2d::Identity(),
                  quarter;
  mirror(0, 0) = -1;
  quarter << 0, -1, 1, 0;
  const std::vector<int> turned = relabeling(t, half), mirrored = relabeling(t, mirror);
  REQUIRE(turned.size() == 20);
  for (int i = 0; i < 20; ++i) {
    CHECK(turned[i] == 19 - i);
    CHECK(mirrored[i] == i / 5 * 5 + 4 - i % 5);
  }
  CHECK(relabeling(t, quarter).empty());
  const std::vector<int> round = relabeling(board(3, 3), quarter);
  REQUIRE(round.size() == 9);
  CHECK(round[4] == 4);
  CHECK(round[0] == 2);  // (0, 0) comes to lie on (2, 0)
  View v;
  v.ids = {0, 7, 19};
  relabel(v, t, turned);
  CHECK(v.ids == std::vector<int>{19, 12, 0});
}

/// Views that list the corners of tags as others do: (row, column, corner) as written by the rig's.
TEST_CASE("hypotheses: other orders of the corners of tags") {
  EyeInHand e;
  GridLayout grid;
  grid.kind = GridLayout::Kind::tags;
  grid.rows = 2, grid.columns = 3, grid.gap = 0.3;
  e.rig.targets[0].type = "apriltag_grid";
  e.rig.targets[0].layout = grid_layout(grid);
  for (Sample& s : e.samples) s.views[0].ids = {0, 1, 2, 3, 9};
  const ParameterTable table(e.rig);
  FreedNames freed;
  freed.parameter.assign(table.all.size(), 0);
  freed.whole = freed.parameter;
  // What the rig's corners 0 to 3 of the first tag, and 1 of the third one, are listed as.
  const std::pair<std::string, std::vector<int>> cases[] = {
      {"the corners of each tag of target 'board' begin with the upper left one and go clockwise "
       "(or only the tags are numbered mirrored: the last row first: the data are the same)",
       {3, 2, 1, 0, 10}},
      {"the corners of each tag of target 'board' begin with the lower right one and go "
       "counter-clockwise",
       {1, 2, 3, 0, 10}},
      {"the corners of each tag of target 'board' begin with the lower left one and go clockwise",
       {0, 3, 2, 1, 11}},
      {"the tags of target 'board' are numbered mirrored: the last row first, and their corners "
       "begin with the lower left one and go counter-clockwise",
       {12, 13, 14, 15, 21}}};
  const std::vector<Hypothesis> all = hypotheses(e.rig, table, e.samples, freed);
  for (const auto& [mistake, meant] : cases) {
    INFO(mistake);
    const auto found = std::find_if(all.begin(), all.end(), [&, &mistake = mistake](const auto& h) {
      return h.mistake == mistake;
    });
    REQUIRE(found != all.end());
    CHECK(found->kind == NoticeKind::numbering);
    CHECK(found->undo(Recording(e.rig, e.samples)).samples[0].views[0].ids == meant);
  }
}

TEST_CASE("hypotheses: undone twice is nothing done") {
  const EyeInHand e;
  const ParameterTable table(e.rig);
  FreedNames freed;
  freed.parameter.assign(table.all.size(), 0);
  freed.whole = freed.parameter;
  int tried = 0;
  for (const Hypothesis& h : hypotheses(e.rig, table, e.samples, freed)) {
    if (h.kind != NoticeKind::numbering && h.kind != NoticeKind::mirrored &&
        h.kind != NoticeKind::joint_sign && h.kind != NoticeKind::inverted_pose &&
        h.kind != NoticeKind::eye_in_hand)
      continue;
    const Recording twice = h.undo(h.undo(Recording(e.rig, e.samples)));
    const Rig& rig = twice.rig;
    const std::vector<Sample>& samples = twice.samples;
    ++tried;
    INFO(id(h.kind) << ": " << h.mistake);
    CHECK(rig.sensors[0].link == 3);
    CHECK((rig.sensors[0].link_T_sensor.translation - e.rig.sensors[0].link_T_sensor.translation)
              .norm() < 1e-12);
    CHECK((rig.targets[0].link_T_target.translation - e.rig.targets[0].link_T_target.translation)
              .norm() < 1e-12);
    for (size_t i = 0; i < samples.size(); ++i) {
      CHECK(samples[i].readings == e.samples[i].readings);
      REQUIRE(samples[i].views.size() == 1);
      CHECK(samples[i].views[0].ids == e.samples[i].views[0].ids);
      for (size_t k = 0; k < samples[i].views[0].z.size(); ++k)
        CHECK(samples[i].views[0].z[k] == Approx(e.samples[i].views[0].z[k]).margin(1e-9));
    }
  }
  CHECK(tried >= 10);
}

TEST_CASE("doctor: clean data have no findings, in any order of the samples") {
  EyeInHand e;
  const Diagnosis d = e.check();
  CHECK(d.findings.empty());
  CHECK(d.tested.size() == 40);
  REQUIRE(d.chi2);
  CHECK(*d.chi2 / d.dof == Approx(1).margin(0.15));
  std::reverse(e.samples.begin(), e.samples.end());
  const Diagnosis r = e.check();
  CHECK(r.findings.empty());
  CHECK(*r.chi2 == Approx(*d.chi2).epsilon(1e-6));
}

TEST_CASE("doctor: of many boards, whose sizes are tried together, only the wrong one is named") {
  EyeInHand e(5);
  e.rig.targets[3].square *= 1.09;               // (5 % and 6 cm of its place look alike)
  e.rig.steps[0].free = {"sensor/camera/pose"};  // the boards stand where the rig says
  const Diagnosis d = e.check();
  INFO(d.verdict);
  REQUIRE(ids(d) == Ids{"square"});
  CHECK(names_of(d.findings[0].where) == Ids{"board3"});
  CHECK(sentences(d.findings[0]).find("The size of target 'board3'") == 0);
  for (const char* right : {"'board'", "'board1'", "'board2'", "'board4'"})
    CHECK(sentences(d.findings[0]).find(right) == std::string::npos);
}

TEST_CASE("doctor: planted mistakes of a camera in the hand") {
  EyeInHand e;
  SECTION("square") {
    e.rig.targets[0].square = 0.06;
    const Diagnosis d = e.check();
    INFO(d.verdict);
    REQUIRE(ids(d) == Ids{"square"});
    CHECK(sentences(d.findings[0]).find("0.0500") + 1 + sentences(d.findings[0]).find("0.05 m") +
              1 + sentences(d.findings[0]).find("0.0499") + 1 >
          0);
    CHECK(*d.findings[0].chi2_corrected < *d.findings[0].chi2_as_is / 1.6);
  }
  SECTION("millimetres") {
    e.rig.targets[0].square = 50;
    CHECK(ids(e.check()) == Ids{"square"});
  }
  SECTION("rows and columns") {
    e.rig.targets[0].layout = board(7, 5).layout;
    CHECK(ids(e.check()) == Ids{"rows-columns"});
  }
  SECTION("joint sign") {
    for (Sample& s : e.samples) s.readings[1] = -s.readings[1];
    const Diagnosis d = e.check();
    REQUIRE(ids(d) == Ids{"joint-sign"});
    CHECK(names_of(d.findings[0].where) == Ids{"lift"});
  }
  SECTION("wrong sides") {
    std::swap(e.rig.sensors[0].link, e.rig.targets[0].link);
    CHECK(ids(e.check()) == Ids{"eye-in-hand"});
  }
  SECTION("inverted pose") {
    e.rig.sensors[0].link_T_sensor = inverse(e.rig.sensors[0].link_T_sensor);
    const Diagnosis d = e.check();
    REQUIRE(ids(d) == Ids{"inverted-pose"});
    CHECK(names_of(d.findings[0].where) == Ids{"camera"});
  }
  SECTION("one view from the other corner") {
    std::reverse(e.samples[4].views[0].ids.own().begin(), e.samples[4].views[0].ids.own().end());
    const Diagnosis d = e.check();
    REQUIRE(ids(d) == Ids{"numbering"});
    CHECK(names_of(d.findings[0].where) == Ids{"camera", e.samples[4].id});
  }
  SECTION("all views from the other corner") {
    for (Sample& s : e.samples)
      std::reverse(s.views[0].ids.own().begin(), s.views[0].ids.own().end());
    CHECK(ids(e.check()) == Ids{"numbering"});
  }
  SECTION("bad samples") {
    std::swap(e.samples[2].readings, e.samples[9].readings);
    const Diagnosis d = e.check();
    REQUIRE(ids(d) == Ids{"bad-samples"});
    CHECK(names_of(d.findings[0].where) == Ids{e.samples[2].id, e.samples[9].id});
  }
  SECTION("duplicates") {
    e.samples.push_back(e.samples[3]);
    e.samples.back().id = "again";
    const Diagnosis d = e.check();
    REQUIRE(ids(d) == Ids{"duplicates"});
    CHECK(names_of(d.findings[0].where) == Ids{e.samples[3].id, "again"});
    CHECK(!d.findings[0].chi2_as_is);
    e.samples.push_back(e.samples[5]);
    e.samples.back().id = "once more";
    const Diagnosis both = e.check();
    REQUIRE(ids(both) == Ids{"duplicates"});
    CHECK(names_of(both.findings[0].where) ==
          Ids{e.samples[3].id, "again", e.samples[5].id, "once more"});
    CHECK_THAT(sentences(both.findings[0]), Catch::StartsWith("4 samples are 2 measurements"));
  }
  SECTION("a joint that never moves") {
    e.rig.steps[0].free.push_back("joint/roll/offset");
    std::vector<Sample> some;
    for (Sample& s : e.samples) s.readings[2] = e.samples[0].readings[2];
    const Diagnosis d = e.check();
    CHECK(std::count_if(d.findings.begin(), d.findings.end(), [](const Notice& f) {
            return f.kind == NoticeKind::still_joint && names_of(f.where) == Ids{"roll"};
          }) == 1);
  }
}

TEST_CASE("doctor: a board that was moved is named, with the sample and how far") {
  for (const size_t from : {size_t{5}, size_t{9}}) {
    EyeInHand e;
    const ParameterTable table(e.rig);
    SimulationOptions options;
    options.seed = 3;
    options.samples = static_cast<int>(e.samples.size());
    for (const Sample& s : e.samples) options.postures.push_back({s.id, s.readings, {}, {}});
    VectorXd truth = table.initial;
    const int board = table.all[table.target_pose[0]].start;
    set_pose(
        truth, board,
        get_pose(truth, board) * exp_se3((Vector6d() << 0.006, -0.008, 0, 0, 0, 0.02).finished()));
    const std::vector<Sample> later = simulate(e.rig, table, truth, options).samples;
    REQUIRE(later.size() == e.samples.size());
    truth = table.initial;
    const std::vector<Sample> sooner = simulate(e.rig, table, truth, options).samples;
    for (size_t i = 0; i < later.size(); ++i)
      e.samples[i].views = (i < from ? sooner : later)[i].views;
    for (size_t i = 0; i < later.size(); ++i) e.samples[i].readings = later[i].readings;
    const Diagnosis d = e.check();
    INFO(d.verdict);
    REQUIRE(ids(d) == Ids{"moved-target"});
    CHECK(names_of(d.findings[0].where) == Ids{"board", e.samples[from].id});
    const std::string text = sentences(d.findings[0]);
    CHECK(std::stod(text.substr(text.find(": by ") + 5)) == Approx(10).margin(0.5));  // mm
    CHECK_THAT(text, Catch::Contains(" mm and 2"));
  }
}

TEST_CASE("doctor: a free board that nobody else sees says nothing of the camera's place") {
  EyeInHand e;
  e.rig.targets[0].link = -1;
  e.rig.steps[0].free = {"sensor/camera/pose"};
  const Diagnosis d = e.check();
  REQUIRE(ids(d) == Ids{"disconnected"});
  CHECK(names_of(d.findings[0].where) == Ids{"camera"});
  e.rig.steps[0].free = {"sensor/camera/intrinsics"};  // these it shows
  CHECK(e.check().findings.empty());
}

TEST_CASE("doctor: a first look ends where the samples have too few numbers") {
  EyeInHand e;
  e.samples.resize(6);
  e.samples[2].views.clear();  // a sample that can never be chosen
  for (const size_t unknowns : {size_t{1}, size_t{1000000}}) {
    const std::vector<Sample> some = some_samples(Recording(e.rig, e.samples), unknowns);
    CHECK(some.size() >= 4);
    CHECK(some.size() <= 5);
  }
}

TEST_CASE("doctor: a joint without limits may have turned many times, or be in degrees") {
  EyeInHand e;
  e.rig.tree.joints[2].type = JointType::continuous;
  for (Sample& sample : e.samples) sample.readings[2] += 2 * kPi * 20;
  CHECK(e.check().findings.empty());
  for (Sample& sample : e.samples) sample.readings[2] *= 180 / kPi;
  const Diagnosis d = e.check();
  REQUIRE(ids(d) == Ids{"degrees"});
  CHECK(names_of(d.findings[0].where) == Ids{"roll"});
}

TEST_CASE("doctor: what a mistake leaves out has the noise of what it keeps") {
  // Else leaving out samples of a fit that explains nothing is likelier than any mistake.
  const EyeInHand e;
  const Recording given(e.rig, e.samples),
      kept(e.rig, std::vector<Sample>(e.samples.begin() + 1, e.samples.end()));
  TrialFit fit;
  fit.dof = 1000;
  for (size_t i = 0; i < kept.samples.size(); ++i) fit.samples.push_back(static_cast<int>(i));
  const double wrong = 6 * std::log(300 / std::sqrt(2 * kPi)), residuals = 12;
  for (const double noise : {1.0, 100.0}) {
    fit.chi2 = fit.cost = noise * noise * 1000;
    CHECK(log_left_out(given, kept, fit) == Approx(-wrong - residuals * std::log(noise)));
  }
}

TEST_CASE("doctor: progress cancels") {
  EyeInHand e;
  for (Sample& s : e.samples) s.readings[1] = -s.readings[1];
  DoctorOptions options;
  int calls = 0;
  options.progress = Progress([&](const Progress::News&) { return ++calls < 20; });
  CHECK(!diagnose(e.rig, e.samples, options));
  CHECK(calls == 20);
}

TEST_CASE("doctor: the odds of what was tried name the planted mistake") {
  EyeInHand planted;
  for (Sample& s : planted.samples) s.readings[1] = -s.readings[1];
  DoctorOptions options;
  CHECK(diagnose(planted.rig, planted.samples, options)->alternatives.empty());
  options.compare = true;
  const Diagnosis found = *diagnose(planted.rig, planted.samples, options);
  REQUIRE_FALSE(found.alternatives.empty());
  const auto likeliest = std::max_element(
      found.alternatives.begin(), found.alternatives.end(),
      [](const Alternative& a, const Alternative& b) { return a.log_odds < b.log_odds; });
  CHECK(likeliest->kind == NoticeKind::joint_sign);
  CHECK(likeliest->where == Subjects{Subject::joint("lift")});
  CHECK(likeliest->log_odds > std::log(99));
  CHECK(diagnose(EyeInHand().rig, EyeInHand().samples, options)->alternatives.empty());
}

TEST_CASE("doctor: a fisheye that the rig has as another lens") {
  for (const Lens wrong : {Lens::pinhole, Lens::brown_conrady}) {
    EyeInHand e(1, Lens::kannala_brandt);
    CHECK(e.check().findings.empty());
    const std::vector<double> none(wrong == Lens::pinhole ? 0 : 5, 0.0);
    e.rig.sensors[0].model = make_camera(wrong, static_cast<int>(none.size()));
    e.rig.sensors[0].parameters = camera_parameters(wrong, {400, 400, 320, 240}, none, 0);
    const Diagnosis d = e.check();
    REQUIRE(!d.findings.empty());
    INFO(sentences(d.findings[0]));
    CHECK(ids(d) == Ids{"intrinsics"});
    CHECK_THAT(sentences(d.findings[0]), Catch::Contains("kannala_brandt rather than"));
  }
}

}  // namespace kincal
