// io/urdf/urdf.h: reading with places, writing by splices, folding offsets, and the proof of what
// was written.
//
// Proves: every kind of mistake is reported with its line and element; with no change the text is
// the same byte for byte, and with changes only the numbers asked for differ; folded offsets
// written to a file mean the calibrated robot by urdfdom's reading (another parser, other
// arithmetic); the proof fails if one number is off by 1e-6. With real files where they are
// present. Does not prove: that a simulator or driver reads the file as urdfdom does (urdfdom is
// what ROS uses); files in UTF-16 (refused).
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <set>

#include "../../../io/document/document.h"
#include "../../../io/document/error.h"
#include "../../../io/document/files.h"
#include "../../../io/document/numbers.h"
#include "../../../io/urdf/edit.h"
#include "../../../io/urdf/proof.h"
#include "../../../io/urdf/urdf.h"
#include "../../../kinematics/tree.h"

namespace urdf_test {

using namespace kincal;
using Catch::Matchers::Contains;
using Catch::Matchers::StartsWith;

namespace {

std::string replace(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

std::string replace_all(std::string text, const std::string& from, const std::string& to) {
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines(1);
  for (char c : text) {
    lines.back() += c;
    if (c == '\n') lines.emplace_back();
  }
  return lines;
}

/// Numbers of the lines (from 1) that differ between two texts of as many lines.
std::set<int> changed_lines(const std::string& before, const std::string& after) {
  const std::vector<std::string> a = lines_of(before), b = lines_of(after);
  REQUIRE(a.size() == b.size());
  std::set<int> changed;
  for (size_t i = 0; i < a.size(); ++i)
    if (a[i] != b[i]) changed.insert(static_cast<int>(i) + 1);
  return changed;
}

int joint_index(const Urdf& urdf, const std::string& name) {
  const int joint = urdf.tree.find_joint(name);
  REQUIRE(joint >= 0);
  return joint;
}

std::vector<Pose> origins_of(const Tree& tree) {
  std::vector<Pose> origins;
  for (const Joint& joint : tree.joints) origins.push_back(joint.parent_T_joint);
  return origins;
}

/// Offsets up to `size` on all joints with a reading, 0 elsewhere.
std::vector<double> random_offsets(const Tree& tree, double size, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::vector<double> offsets;
  for (const Joint& joint : tree.joints) {
    const double u = static_cast<double>(engine() >> 11) * 0x1p-53;
    offsets.push_back(joint.has_reading() ? size * (2 * u - 1) : 0);
  }
  return offsets;
}

/// Small motions of all origins.
std::vector<Pose> random_origins(const Tree& tree, double size, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::vector<Pose> origins = origins_of(tree);
  for (Pose& origin : origins) {
    Vector6d xi;
    for (int i = 0; i < 6; ++i)
      xi(i) = size * (2 * (static_cast<double>(engine() >> 11) * 0x1p-53) - 1);
    origin = origin * exp_se3(xi);
  }
  return origins;
}

std::string write_origins(const Urdf& urdf, const std::vector<Pose>& origins) {
  UrdfChanges changes;
  for (size_t j = 0; j < origins.size(); ++j) changes.origins[static_cast<int>(j)] = origins[j];
  return edit_urdf(urdf, changes);
}

/// Three links, one moving joint, one fixed; line 5 is the origin of the moving joint.
const std::string kSmall = R"(<?xml version="1.0"?>
<robot name="small">
  <link name="base"/>
  <joint name="elbow" type="revolute">
    <origin xyz="0.1 0.2 0.3" rpy="0 0 0.5"/>
    <parent link="base"/>
    <child link="arm"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <link name="arm"/>
  <joint name="mount" type="fixed">
    <origin xyz="0 0 0.1"/>
    <parent link="arm"/>
    <child link="tool"/>
  </joint>
  <link name="tool"/>
</robot>
)";

/// What makes writing hard: fixed joints above the base, single quotes, '>' in a value, joints
/// without origin, origins of visuals and decoys named alike, xyz or rpy missing, numbers with
/// blanks, a mimic of a mimic with negative multipliers, prismatic and oblique axes, mounts at the
/// pole of rpy.
const std::string kHard = R"(<robot name='hard'>
  <!-- <joint name="lift" type="fixed"><origin xyz="9 9 9"/></joint> -->
  <link name="footprint"/>
  <link name="base"><visual><origin xyz="1 1 1" rpy="1 1 1"/><geometry><box size="1 1 1"/></geometry></visual></link>
  <joint name="base_fixed" type="fixed"><parent link="footprint"/><child link="base"/><origin rpy='0.1 0 0' xyz='0 0 0.2'/></joint>
  <joint note="a > b" name="lift" type="prismatic">
    <unknown xyz="7 7 7" rpy="7 7 7"><origin xyz="8 8 8"/></unknown>
    <!-- <origin xyz="9 9 9"/> -->
    <parent link="base"/><child link="torso"/>
    <origin
        xyz = "  -0.05   0 0.7397 " />
    <axis xyz="0 0.6 -0.8"/>
    <limit lower="0" upper="0.33" effort="1" velocity="1"/>
  </joint>
  <link name="torso"/>
  <joint name="pan" type="continuous"><parent link="torso"/><child link="head"/><axis xyz="1 2 -3"/></joint>
  <link name="head"/>
  <joint name="pole" type="revolute">
    <origin note='x="/>"' rpy="0.3 1.5707963267948966 -0.2"/>
    <parent link="head"/><child link="camera"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <link name="camera"/>
  <joint name="finger" type="revolute">
    <origin xyz='0.1 0 +1e-1' rpy='-1.5707963267948966 -1.57079632679 3.141592653589793'></origin>
    <parent link="torso"/><child link="finger"/>
    <axis xyz="0 -1 0"/>
    <limit lower="-0.5" upper="1" effort="1" velocity="1"/>
  </joint>
  <link name="finger"/>
  <joint name="thumb" type="revolute">
    <parent link="torso"/><child link="thumb"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="finger" multiplier="-0.75" offset="0.2"/>
  </joint>
  <link name="thumb"/>
  <joint name="nail" type="prismatic">
    <origin/>
    <parent link="thumb"/><child link="nail"/>
    <axis xyz="0 0 -1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic multiplier="-0.1" joint="thumb"/>
  </joint>
  <link name="nail"/>
  <joint name="eye" type="fixed"><parent link="camera"/><child link="eye"/></joint>
  <link name="eye"/>
  <transmission name="t1"><joint name="pan"/><actuator name="m"><mechanicalReduction> 42.5 </mechanicalReduction></actuator></transmission>
  <transmission name="t2"><actuator name="m2"/><joint name="pole"/><mechanicalReduction>-7</mechanicalReduction></transmission>
  <transmission name="t3"><joint name="lift"><mechanicalReduction>3</mechanicalReduction></joint></transmission>
  <transmission name="two numbers"><joint name="finger"><mechanicalReduction>3</mechanicalReduction></joint>
    <actuator name="m3"><mechanicalReduction>4</mechanicalReduction></actuator></transmission>
  <transmission name="no number"><joint name="finger"/><mechanicalReduction>${gear}</mechanicalReduction></transmission>
  <transmission name="two joints"><joint name="a"/><joint name="b"/><mechanicalReduction>5</mechanicalReduction></transmission>
</robot>)";

/// An edit of kSmall that must be refused, with the line and what the message must hold.
struct Mistake {
  const char* from;
  const char* to;
  const char* place;  // start of the message
  std::vector<const char*> words;
};

}  // namespace

TEST_CASE("a URDF is read: names, origins, axes, limits") {
  const Urdf urdf = parse_urdf(kSmall, "small.urdf");
  CHECK(urdf.warnings.empty());
  CHECK(urdf.text == kSmall);
  CHECK(urdf.tree.links == std::vector<std::string>{"base", "arm", "tool"});
  const Joint& elbow = urdf.tree.joints[0];
  CHECK(elbow.name == "elbow");
  CHECK(elbow.type == JointType::revolute);
  CHECK(elbow.parent_T_joint.translation == Vector3d(0.1, 0.2, 0.3));
  CHECK(elbow.parent_T_joint.rotation == rotation_from_rpy({0, 0, 0.5}));
  CHECK(elbow.axis == Vector3d::UnitZ());
  CHECK(elbow.lower == -1);
  CHECK(elbow.upper == 2);
  CHECK(urdf.tree.joints[1].type == JointType::fixed);
  CHECK(urdf.tree.joints[1].parent_T_joint.rotation == Matrix3d::Identity());
}

TEST_CASE("every mistake is reported with its line, its element and what is valid") {
  const std::vector<Mistake> mistakes{
      {"xyz=\"0.1 0.2 0.3\"",
       "xyz=\"0.1 0.2\"",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"xyz", "2 numbers", "3 are needed"}},
      {"xyz=\"0.1 0.2 0.3\"",
       "xyz=\"0.1 0.2 0.3 0.4\"",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"4 numbers"}},
      {"xyz=\"0.1 0.2 0.3\"", "xyz=\"\"", "r.urdf:5: joint 'elbow': <origin>: ", {"0 numbers"}},
      {"xyz=\"0.1 0.2 0.3\"",
       "xyz=\"0,1 0.2 0.3\"",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"'0,1'", "finite number"}},
      {"xyz=\"0.1 0.2 0.3\"", "xyz=\"nan 0 0\"", "r.urdf:5: joint 'elbow': <origin>: ", {"'nan'"}},
      {"xyz=\"0.1 0.2 0.3\"",
       "xyz=\"0 -inf 0\"",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"'-inf'"}},
      {"xyz=\"0.1 0.2 0.3\"",
       "xyz=\"0 1e999 0\"",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"'1e999'"}},
      {"xyz=\"0.1 0.2 0.3\"", "xyz=\"0 +-1 0\"", "r.urdf:5: joint 'elbow': <origin>: ", {"'+-1'"}},
      {"rpy=\"0 0 0.5\"",
       "rpy=\"0 0 ${a}\"",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"rpy", "'${a}'", "xacro"}},
      {"rpy=\"0 0 0.5\"/>", "/><origin/>", "r.urdf:5: joint 'elbow': <origin>: ", {"twice"}},
      {"xyz=\"0.1 0.2 0.3\"",
       "xyz='0 0 0' xyz='1 1 1'",
       "r.urdf:5: joint 'elbow': <origin>: ",
       {"'xyz'", "twice"}},
      {"<axis xyz=\"0 0 1\"/>",
       "<axis xyz=\"0 0 0\"/>",
       "r.urdf:8: joint 'elbow': <axis>: ",
       {"zero"}},
      {"<axis xyz=\"0 0 1\"/>",
       "<axis xyz=\"0 1\"/>",
       "r.urdf:8: joint 'elbow': <axis>: ",
       {"2 numbers"}},
      {"<axis xyz=\"0 0 1\"/>",
       "<axis/>",
       "r.urdf:8: joint 'elbow': <axis>: ",
       {"'xyz'", "missing"}},
      {"lower=\"-1\"", "lower=\"low\"", "r.urdf:9: joint 'elbow': <limit>: ", {"lower", "'low'"}},
      {"lower=\"-1\"",
       "lower=\"-1 1\"",
       "r.urdf:9: joint 'elbow': <limit>: ",
       {"2 numbers", "1 is needed"}},
      {"type=\"revolute\"",
       "type=\"ball\"",
       "r.urdf:4: joint 'elbow': ",
       {"'ball'", "fixed, revolute, continuous, prismatic"}},
      {" type=\"revolute\"", "", "r.urdf:4: joint 'elbow': ", {"'type'", "missing"}},
      {" name=\"elbow\"", "", "r.urdf:4: <joint>: ", {"'name'", "missing"}},
      {"<link name=\"arm\"/>", "<link/>", "r.urdf:11: <link>: ", {"'name'", "missing"}},
      {"    <parent link=\"base\"/>\n",
       "",
       "r.urdf:4: joint 'elbow': ",
       {"<parent link", "missing"}},
      {"<child link=\"arm\"/>",
       "<child/>",
       "r.urdf:7: joint 'elbow': <child>: ",
       {"'link'", "missing"}},
      {"<parent link=\"base\"/>",
       "<parent link=\"bass\"/>",
       "r.urdf:6: joint 'elbow': <parent>: ",
       {"'bass'", "not defined", "nearest", "base"}},
      {"<child link=\"arm\"/>",
       "<child link=\"arn\"/>",
       "r.urdf:7: joint 'elbow': <child>: ",
       {"'arn'", "not defined", "nearest", "arm"}},
      {"name=\"mount\"", "name=\"elbow\"", "r.urdf:12: joint 'elbow': ", {"r.urdf:4"}},
      {"name=\"tool\"", "name=\"base\"", "r.urdf:17: link 'base': ", {"r.urdf:3"}},
      {"<axis",
       "<mimic joint=\"elbo\"/><axis",
       "r.urdf:8: joint 'elbow': <mimic>: ",
       {"'elbo'", "not defined", "nearest", "elbow"}},
      {"<axis",
       "<mimic joint=\"mount\" multiplier=\"x\"/><axis",
       "r.urdf:8: joint 'elbow': <mimic>: ",
       {"multiplier", "'x'"}},
      {"<axis", "<mimic joint=\"elbow\"/><axis", "r.urdf: ", {"mimics itself"}},
      {"<link name=\"tool\"/>",
       "<link name=\"tool\"/><link name=\"spare\"/>",
       "r.urdf: ",
       {"roots", "'base'", "'spare'"}},
      {"<child link=\"tool\"/>",
       "<child link=\"arm\"/>",
       "r.urdf: ",
       {"two parents", "'elbow'", "'mount'"}},
      {"<parent link=\"base\"/>", "<parent link=\"tool\"/>", "r.urdf: ", {"loop"}},
      {"<link name=\"base\"/>",
       "<link name=\"base\"><gazebo><a:b/></gazebo></link>",
       "r.urdf:3: ",
       {"unbound prefix", "'a:b'", "xmlns:a"}},
      {"<link name=\"base\"/>",
       "<link name=\"base\" a:b=\"1\"/>",
       "r.urdf:3: ",
       {"unbound prefix", "'a:b'"}},
      {"    <parent link=\"arm\"/>",
       "    <parent link=\"arm\">",
       "r.urdf:16: ",
       {"not well-formed"}},
      {"</robot>\n", "", "r.urdf:17: ", {"not well-formed"}},
      {"</robot>\n", "</robot>\n<robot/>\n", "r.urdf:19: ", {"not well-formed", "after the end"}},
      {"<robot name=\"small\">", "<robot name=\"small>", "r.urdf:", {"not well-formed"}},
  };
  for (const Mistake& mistake : mistakes) {
    for (const bool crlf : {false, true}) {
      std::string text = replace(kSmall, mistake.from, mistake.to);
      if (crlf) text = "\xEF\xBB\xBF" + replace_all(text, "\n", "\r\n");
      INFO(mistake.from << " -> " << mistake.to);
      std::string message = "no error";
      try {
        parse_urdf(text, "r.urdf");
      } catch (const InputError& e) {
        message = e.what();
      }
      CHECK_THAT(message, StartsWith(mistake.place));
      for (const char* word : mistake.words) CHECK_THAT(message, Contains(word));
    }
  }
}

TEST_CASE("what is no URDF is refused") {
  CHECK_THROWS_WITH(parse_urdf("<sdf/>", "r.urdf"),
                    StartsWith("r.urdf:1: <sdf>") && Contains("<robot>"));
  CHECK_THROWS_WITH(parse_urdf("", "r.urdf"), StartsWith("r.urdf:1: "));
  CHECK_THROWS_WITH(parse_urdf("robot: yaml\n", "r.urdf"), StartsWith("r.urdf:"));
  CHECK_THROWS_WITH(parse_urdf(std::string("\xFF\xFE<\0r\0", 6), "r.urdf"), Contains("UTF-16"));
  CHECK_THROWS_WITH(parse_urdf("\n<robot name='a'/>", "r.urdf"),
                    StartsWith("r.urdf:2: ") && Contains("no links"));
  CHECK_THROWS_WITH(parse_urdf("<robot xmlns:xacro='x'><xacro:arm/></robot>", "r.urdf"),
                    Contains("no links") && Contains("<xacro:arm>") && Contains("run xacro"));
  CHECK_THROWS_AS(read_urdf("there/is/no/such.urdf"), InputError);
}

TEST_CASE("an undefined root is accepted with a warning, if it can only be meant so") {
  const std::string rootless = replace(kSmall, "<link name=\"base\"/>", "");
  const Urdf urdf = parse_urdf(rootless, "r.urdf");
  REQUIRE(urdf.warnings.size() == 1);
  CHECK_THAT(urdf.warnings[0],
             StartsWith("r.urdf:6: joint 'elbow': <parent>: ") && Contains("'base'"));
  CHECK(urdf.tree.links[urdf.tree.root] == "base");
  CHECK(edit_urdf(urdf, {}) == rootless);
  // Two undefined names.
  CHECK_THROWS_WITH(
      parse_urdf(replace(rootless, "<parent link=\"arm\"/>", "<parent link=\"world\"/>"), "r.urdf"),
      Contains("not defined"));
  // An undefined child as well.
  CHECK_THROWS_WITH(parse_urdf(replace(rootless, "<link name=\"arm\"/>", ""), "r.urdf"),
                    Contains("not defined"));
}

TEST_CASE("what kinematics do not need does not stop the parser") {
  std::string text = replace(kSmall, "<link name=\"base\"/>",
                             "<link name=\"base\"><visual><origin xyz=\"${x} "
                             "0\"/></visual><collision><origin rpy=\"$(arg y)\"/>"
                             "</collision><joint name=\"elbow\"/></link><gazebo><link "
                             "name=\"base\"/><joint name=\"q\"/></gazebo>");
  text = replace(
      text, "<origin xyz=\"0 0 0.1\"/>",
      "<origin xyz=\"0 0 0.1\"/><axis xyz=\"0 0 0\"/><limit lower=\"${l}\"/><mimic joint=\"q\"/>");
  text = replace(
      text, "<robot name=\"small\">",
      "<robot name=\"small\" xmlns:x=\"http://x\" xml:lang=\"en\"><x:extra x:y=\"1\"/><x:joint/>");
  const Urdf urdf = parse_urdf(text, "r.urdf");
  CHECK(urdf.tree.joints.size() == 2);
  CHECK_FALSE(urdf.tree.joints[1].mimic);
  CHECK(edit_urdf(urdf, {}) == text);
}

TEST_CASE("defaults and odd numbers") {
  const auto elbow = [](const char* from, const char* to) {
    return parse_urdf(replace(kSmall, from, to), "r.urdf").tree.joints[0];
  };
  CHECK(elbow("<axis xyz=\"0 0 1\"/>", "").axis == Vector3d::UnitX());
  CHECK(elbow("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 -3 4\"/>")
            .axis.isApprox(Vector3d(0, -0.6, 0.8), 1e-15));
  CHECK(elbow("<limit lower=\"-1\" upper=\"2\"", "<limit upper=\"2\"").upper == 0);
  CHECK(elbow("    <limit lower=\"-1\" upper=\"2\" effort=\"1\" velocity=\"1\"/>\n", "").upper ==
        0);
  CHECK(elbow("xyz=\"0.1 0.2 0.3\"", "xyz=\" +1\t-2e-1\n  .5 \"").parent_T_joint.translation ==
        Vector3d(1, -0.2, 0.5));
  CHECK(elbow("xyz=\"0.1 0.2 0.3\"", "xyz=\"4.9e-324 -0 1.7976931348623157e308\"")
            .parent_T_joint.translation.z() == 1.7976931348623157e308);
  const Urdf inverted = parse_urdf(replace(kSmall, "lower=\"-1\"", "lower=\"3\""), "r.urdf");
  REQUIRE(inverted.warnings.size() == 1);
  CHECK_THAT(inverted.warnings[0], StartsWith("r.urdf:9: joint 'elbow': <limit>: "));
  CHECK(inverted.tree.joints[0].lower == inverted.tree.joints[0].upper);
  const Urdf degrees = parse_urdf(replace(kSmall, "rpy=\"0 0 0.5\"", "rpy=\"0 0 -90\""), "r.urdf");
  REQUIRE(degrees.warnings.size() == 1);
  CHECK_THAT(
      degrees.warnings[0],
      StartsWith("r.urdf:5: joint 'elbow': <origin>: an angle of rpy is 90, more than a turn"));
  CHECK(parse_urdf(replace(kSmall, "rpy=\"0 0 0.5\"", "rpy=\"0 0 6.2832\""), "r.urdf")
            .warnings.empty());
}

TEST_CASE("with no change the text is the same, byte for byte") {
  for (const std::string& text :
       {kSmall, kHard, replace_all(kHard, "\n", "\r\n"), "\xEF\xBB\xBF" + kSmall,
        "\xEF\xBB\xBF" + replace_all(kSmall, "\n", "\r\n"),
        "\n\n<!-- head -->" + kHard + "<!-- tail -->\n\n\n",
        replace(kSmall, "version=\"1.0\"", "version=\"1.0\" encoding=\"ISO-8859-1\"") +
            "<!-- \xE4 -->"}) {
    const Urdf urdf = parse_urdf(text, "r.urdf");
    CHECK(edit_urdf(urdf, {}) == text);
    CHECK(write_origins(urdf, origins_of(urdf.tree)) == text);
    UrdfChanges changes;
    for (const Transmission& t : urdf.transmissions) changes.reductions[t.joint] = t.reduction;
    CHECK(edit_urdf(urdf, changes) == text);
  }
}

TEST_CASE("only the lines of changed joints differ, and in them only the numbers") {
  for (const bool crlf : {false, true}) {
    const std::string text = crlf ? "\xEF\xBB\xBF" + replace_all(kSmall, "\n", "\r\n") : kSmall;
    const Urdf urdf = parse_urdf(text, "r.urdf");
    UrdfChanges changes;
    changes.origins[0] = urdf.tree.joints[0].parent_T_joint;
    changes.origins[0].translation.y() = -0.0;
    CHECK(edit_urdf(urdf, changes) ==
          replace(text, "0.1 0.2 0.3", "0.1 0 0.3"));  // rpy untouched, "-0" not written
    changes.origins[0].rotation = rotation_from_rpy({0, 0, -0.25});
    CHECK(edit_urdf(urdf, changes) ==
          replace(replace(text, "0.1 0.2 0.3", "0.1 0 0.3"), "0 0 0.5", "0 0 -0.25"));
    changes.origins = {
        {1, {rotation_from_rpy({0, 0, 1}), urdf.tree.joints[1].parent_T_joint.translation}}};
    const std::string turned = edit_urdf(urdf, changes);
    CHECK(turned ==
          replace(text, "<origin xyz=\"0 0 0.1\"/>", "<origin rpy=\"0 0 1\" xyz=\"0 0 0.1\"/>"));
    CHECK(changed_lines(text, turned) == std::set<int>{13});
  }
}

TEST_CASE("origins are written wherever they stand or do not stand") {
  const Urdf urdf = parse_urdf(kHard, "r.urdf");
  const Pose to{rotation_from_rpy({0, 0, 0.5}), {1, 2, 3}};
  const auto edit = [&](const std::string& joint) {
    UrdfChanges changes;
    changes.origins[joint_index(urdf, joint)] = to;
    const std::string text = edit_urdf(urdf, changes);
    const Pose read =
        parse_urdf(text, "r.urdf").tree.joints[joint_index(urdf, joint)].parent_T_joint;
    CHECK(read.translation == to.translation);
    CHECK(read.rotation == to.rotation);
    return text;
  };
  CHECK(edit("base_fixed") ==
        replace(kHard, "rpy='0.1 0 0' xyz='0 0 0.2'", "rpy='0 0 0.5' xyz='1 2 3'"));
  CHECK(edit("lift") == replace(kHard, "<origin\n        xyz = \"  -0.05   0 0.7397 \" />",
                                "<origin rpy=\"0 0 0.5\"\n        xyz = \"1 2 3\" />"));
  CHECK(edit("pan") == replace(kHard, "type=\"continuous\">",
                               "type=\"continuous\"><origin xyz=\"1 2 3\" rpy=\"0 0 0.5\"/>"));
  CHECK(edit("pole") == replace(kHard,
                                "<origin note='x=\"/>\"' rpy=\"0.3 1.5707963267948966 -0.2\"/>",
                                "<origin xyz=\"1 2 3\" note='x=\"/>\"' rpy=\"0 0 0.5\"/>"));
  CHECK(edit("nail") == replace(kHard, "<origin/>", "<origin xyz=\"1 2 3\" rpy=\"0 0 0.5\"/>"));
  CHECK(changed_lines(kHard, edit("thumb")).size() == 1);

  const Urdf broken = parse_urdf(replace(kSmall, "0.1 0.2 0.3", "\n 0.1\t0.2\n0.3 "),
                                 "r.urdf");  // a value over three lines
  CHECK(edit_urdf(broken, {{{0, {broken.tree.joints[0].parent_T_joint.rotation, to.translation}}},
                           {}}) == replace(kSmall, "0.1 0.2 0.3", "1 2 3"));

  UrdfChanges bad;
  bad.origins[0].translation.x() = NAN;
  CHECK_THROWS_AS(edit_urdf(urdf, bad), std::invalid_argument);
}

TEST_CASE("an origin's own digits are told") {
  const Urdf urdf = parse_urdf(kHard, "r.urdf");
  CHECK(urdf.origins.at(joint_index(urdf, "finger")).xyz == "0.1 0 +1e-1");
  CHECK(urdf.origins.at(joint_index(urdf, "finger")).rpy ==
        "-1.5707963267948966 -1.57079632679 3.141592653589793");
  CHECK(urdf.origins.at(joint_index(urdf, "pole")).xyz == "0 0 0");
  CHECK(urdf.origins.at(joint_index(urdf, "pan")).rpy == "0 0 0");
}

TEST_CASE("mechanical reductions are read where they are beyond doubt, and written in place") {
  const Urdf urdf = parse_urdf(kHard, "r.urdf");
  REQUIRE(urdf.transmissions.size() == 3);
  CHECK(urdf.transmissions[0].name == "t1");
  CHECK(urdf.transmissions[0].joint == "pan");
  CHECK(urdf.transmissions[0].reduction == 42.5);
  CHECK(urdf.transmissions[1].joint == "pole");
  CHECK(urdf.transmissions[1].reduction == -7);
  CHECK(urdf.transmissions[2].joint == "lift");
  UrdfChanges changes;
  changes.reductions = {{"pan", 42.25}, {"pole", -7.125}, {"lift", 3}};
  CHECK(edit_urdf(urdf, changes) ==
        replace(replace(kHard, "> 42.5 <", "> 42.25 <"), ">-7<", ">-7.125<"));
  changes.reductions = {{"finger", 2}};
  CHECK_THROWS_WITH(edit_urdf(urdf, changes), Contains("'finger'"));
}

TEST_CASE("folded offsets go into the origins of joints and of their followers") {
  const Urdf urdf = parse_urdf(kHard, "r.urdf");
  const Tree& tree = urdf.tree;
  const std::vector<Pose> origins = origins_of(tree);
  std::vector<double> offsets(tree.joints.size(), 0);
  offsets[joint_index(urdf, "finger")] = 0.1;
  offsets[joint_index(urdf, "lift")] = -0.02;
  const std::vector<Pose> folded = fold_offsets(tree, origins, offsets);
  for (size_t j = 0; j < folded.size(); ++j) {
    const std::string& name = tree.joints[j].name;
    const double d = name == "finger"  ? 0.1
                     : name == "thumb" ? -0.075
                     : name == "nail"  ? 0.0075
                     : name == "lift"  ? -0.02
                                       : 0;
    const Pose expected = origins[j] * joint_motion(tree.joints[j], d);
    INFO(name);
    CHECK((folded[j].rotation - expected.rotation).cwiseAbs().maxCoeff() < 1e-16);
    CHECK((folded[j].translation - expected.translation).cwiseAbs().maxCoeff() < 1e-16);
  }
}

TEST_CASE("fold, write, prove: the written file means the calibrated robot") {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Urdf urdf = parse_urdf(kHard, "r.urdf");
    const std::vector<Pose> origins =
        seed % 2 ? origins_of(urdf.tree) : random_origins(urdf.tree, 0.01, seed);
    const std::vector<double> offsets = random_offsets(urdf.tree, 0.2, seed);
    const std::string text = write_origins(urdf, fold_offsets(urdf.tree, origins, offsets));
    CHECK_NOTHROW(prove_urdf(text, urdf, origins, offsets));
    CHECK_THROWS_AS(prove_urdf(text, urdf, origins, std::vector<double>(offsets.size(), 0)),
                    std::runtime_error);
    if (seed % 2) {  // offsets alone: fixed joints keep their bytes
      CHECK_THAT(text, Contains("rpy='0.1 0 0' xyz='0 0 0.2'") &&
                           Contains("<joint name=\"eye\" type=\"fixed\"><parent"));
    }
  }
}

TEST_CASE("what follows a joint that does not move stands still, and the proof says where") {
  for (const char* type : {"fixed", "floating", "planar"}) {
    const Urdf urdf =
        parse_urdf(replace(replace(kHard, "name=\"eye\" type=\"fixed\"",
                                   std::string("name=\"eye\" type=\"") + type + "\""),
                           "<mimic joint=\"finger\" multiplier", "<mimic joint=\"eye\" multiplier"),
                   "r.urdf");
    INFO(type);
    for (const char* follower : {"thumb", "nail"})  // it follows the thumb
      CHECK_FALSE(urdf.tree.joints[joint_index(urdf, follower)].moves());
    const std::vector<Pose> origins = random_origins(urdf.tree, 0.01, 1);
    const std::vector<double> offsets = random_offsets(urdf.tree, 0.1, 2);
    const std::string text = write_origins(urdf, fold_offsets(urdf.tree, origins, offsets));
    CHECK_NOTHROW(prove_urdf(text, urdf, origins, offsets));
    CHECK_THROWS_WITH(
        prove_urdf(replace(text, "offset=\"0.2\"", "offset=\"0.200001\""), urdf, origins, offsets),
        Contains("'thumb'"));
  }
}

TEST_CASE("the proof fails if any number of any origin or mimic is off by 1e-6") {
  const Urdf urdf = parse_urdf(kHard, "r.urdf");
  const std::vector<Pose> origins = random_origins(urdf.tree, 0.01, 1);
  const std::vector<double> offsets = random_offsets(urdf.tree, 0.1, 2);
  const std::vector<Pose> folded = fold_offsets(urdf.tree, origins, offsets);
  const std::string text = write_origins(urdf, folded);
  REQUIRE_NOTHROW(prove_urdf(text, urdf, origins, offsets));
  for (const Joint& joint : urdf.tree.joints) {
    const int j = urdf.tree.find_joint(joint.name);
    const OriginText written = parse_urdf(text, "r.urdf").origins.at(j);
    for (const std::string& numbers : {written.xyz, written.rpy})
      for (size_t begin = 0; begin < numbers.size();) {
        const size_t end = std::min(numbers.find(' ', begin), numbers.size());
        std::string off = numbers;
        off.replace(begin, end - begin,
                    shortest(std::stod(numbers.substr(begin, end - begin)) + 1e-6));
        INFO(joint.name << ": " << numbers << " -> " << off);
        CHECK_THROWS_WITH(prove_urdf(replace(text, numbers, off), urdf, origins, offsets),
                          Contains("'" + urdf.tree.links[joint.child] + "'") && Contains("e-0"));
        begin = end + 1;
      }
  }
  CHECK_THROWS_WITH(prove_urdf(replace(text, "\"-0.75\"", "\"-0.750001\""), urdf, origins, offsets),
                    Contains("'thumb'"));
  CHECK_THROWS_WITH(prove_urdf(replace(text, "\"0.2\"", "\"0.200001\""), urdf, origins, offsets),
                    Contains("'thumb'"));
  CHECK_THROWS_WITH(prove_urdf(replace(text, "\"1 2 -3\"", "\"1 2 3\""), urdf, origins, offsets),
                    Contains("'head'"));
}

TEST_CASE("the proof refuses a text that holds another robot") {
  const Urdf urdf = parse_urdf(kSmall, "r.urdf");
  const std::vector<Pose> origins = origins_of(urdf.tree);
  const std::vector<double> zero(2, 0);
  CHECK_NOTHROW(prove_urdf(kSmall, urdf, origins, zero));
  CHECK_THROWS_WITH(prove_urdf(kHard, urdf, origins, zero), Contains("number of joints"));
  CHECK_THROWS_WITH(prove_urdf(replace(kSmall, "\"mount\"", "\"mound\""), urdf, origins, zero),
                    Contains("'mount'"));
  CHECK_THROWS_WITH(prove_urdf(replace(kSmall, "<parent link=\"arm\"/>", "<parent link=\"base\"/>"),
                               urdf, origins, zero),
                    Contains("'mount'"));
  CHECK_THROWS_WITH(prove_urdf(replace(kSmall, "0.1 0.2 0.3", "0.1 0.2"), urdf, origins, zero),
                    Contains("urdfdom"));
}

TEST_CASE("where urdfdom refuses the input, the proof reads with our parser") {
  const Urdf urdf =
      parse_urdf(replace(kSmall, "<link name=\"base\"/>", ""), "r.urdf");  // an undefined root
  const std::vector<double> offsets{0.1, 0};
  const std::string text =
      write_origins(urdf, fold_offsets(urdf.tree, origins_of(urdf.tree), offsets));
  CHECK_NOTHROW(prove_urdf(text, urdf, origins_of(urdf.tree), offsets));
  CHECK_THROWS_WITH(prove_urdf(replace(text, "0.1 0.2 0.3", "0.1 0.2 0.300001"), urdf,
                               origins_of(urdf.tree), offsets),
                    Contains("'arm'"));
}

namespace {

std::string data_folder() {
  if (const char* folder = std::getenv("KINCAL_DATA")) return folder;
#ifdef KINCAL_SOURCE_DIR
  return KINCAL_SOURCE_DIR "/../shared/data";
#else
  return "";
#endif
}

struct RealFile {
  const char* name;
  const char* error;  // what the message must hold; null: loads
  int warnings;
};

const std::vector<RealFile> kRealFiles{
    {"pr2_robotassets.urdf", nullptr, 0},
    {"pr2_drake_simplified.urdf", nullptr, 1},
    {"baxter.urdf", nullptr, 0},
    {"sawyer.urdf", nullptr, 0},
    {"yumi.urdf", nullptr, 0},
    {"dual_panda.urdf", nullptr, 0},
    {"fetch.urdf", nullptr, 0},
    {"ur5.urdf", nullptr, 0},
    {"abb_irb6600_parallel.urdf", nullptr, 0},
    {"abb_irb2400.urdf", nullptr, 0},
    {"puma560.urdf", nullptr, 0},
    {"kinova_movo.urdf", nullptr, 0},
    {"robotiq_2f85_mimic.urdf", nullptr, 0},
    {"robotiq_tendons_loop.urdf", nullptr, 0},
    {"eve_r3_humanoid.urdf", nullptr, 0},
    {"atlas_drake.urdf", nullptr, 0},
    {"cassie_v2.urdf", nullptr, 0},
    {"allegro_left.urdf", nullptr, 0},
    {"barrett_hand.URDF", nullptr, 0},
    {"spot_arm_xacro_leftover.urdf", nullptr, 1},
    {"mir_base.urdf", nullptr, 0},
    {"digit.urdf", nullptr, 0},
    {"icub_genova11.urdf", nullptr, 0},
    {"pioneer3dx.urdf", nullptr, 0},
    {"gingerurdf.urdf", nullptr, 0},
    {"edge_link_joint_same_name.urdf", nullptr, 0},
    {"edge_unicode.urdf", nullptr, 1},
    {"edge_drake_joint_parsing_test.urdf",
     ".urdf:91: joint 'fixed_joint': <parent>: link 'world' is not defined", 0},
    {"edge_no_links.urdf", ".urdf:6: the robot has no links; <xacro:make_pelvis> is not expanded",
     0},
    {"edge_r2_left_gripper_dup_links.urdf", ": link 'r2/left_leg/ati': the name is taken already",
     0},
    {"edge_fetch_xml_error.urdf",
     ".urdf:655: not well-formed XML: unbound prefix in 'sensor:camera'", 0},
};

}  // namespace

TEST_CASE("real robots load or fail as they must, keep their bytes, and carry folded offsets") {
  const std::string folder = data_folder() + "/urdf/";
  if (!std::ifstream(folder + kRealFiles[0].name)) {
    WARN("skipped: no real URDFs in KINCAL_DATA");
    return;
  }
  for (const RealFile& file : kRealFiles) {
    INFO(file.name);
    if (file.error) {
      CHECK_THROWS_WITH(read_urdf(folder + file.name),
                        StartsWith(folder + file.name) && Contains(file.error));
      continue;
    }
    const Urdf urdf = read_urdf(folder + file.name);
    for (const std::string& warning : urdf.warnings) UNSCOPED_INFO(warning);
    CHECK(urdf.warnings.size() == static_cast<size_t>(file.warnings));
    CHECK(urdf.text == read_file(folder + file.name));
    CHECK(write_origins(urdf, origins_of(urdf.tree)) == urdf.text);

    const std::vector<Pose> origins = origins_of(urdf.tree);
    const std::vector<double> offsets = random_offsets(urdf.tree, 0.05, 3);
    const std::vector<Pose> folded = fold_offsets(urdf.tree, origins, offsets);
    const std::string text = write_origins(urdf, folded);
    CHECK_NOTHROW(prove_urdf(text, urdf, origins, offsets));
    std::set<int> moved;
    for (size_t j = 0; j < origins.size(); ++j)
      if (folded[j].rotation != origins[j].rotation ||
          folded[j].translation != origins[j].translation)
        moved.insert(static_cast<int>(j));
    CHECK(changed_lines(urdf.text, text).size() == moved.size());

    const std::vector<Pose> all = random_origins(urdf.tree, 0.01, 4);
    CHECK_NOTHROW(
        prove_urdf(write_origins(urdf, fold_offsets(urdf.tree, all, offsets)), urdf, all, offsets));
    if (!moved.empty()) {
      CHECK_THROWS_AS(prove_urdf(urdf.text, urdf, origins, offsets), std::runtime_error);
    }
  }
}

}  // namespace urdf_test
