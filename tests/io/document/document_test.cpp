// The strict reader of YAML and JSON: values, places, refusals, and writing.
// Proven: what kincal's own files need, under a decimal comma too. Not proven: conformance of
// yaml-cpp and nlohmann to their standards.
#include "../../../io/document/document.h"
#include "../../../io/document/files.h"
#include "../../../io/document/json.h"
#include "../../../io/document/names.h"
#include "../../../io/document/numbers.h"
#include "../../../io/document/yaml.h"
#include "../../fixtures/decimal_comma.h"

#include <catch2/catch.hpp>
#include <charconv>
#include <cmath>
#include <functional>
#include <random>

namespace document_test {

using namespace kincal;
using Catch::Matchers::Contains;
using kincal::fixture::DecimalComma;

namespace {

/// The text of the InputError that `f` throws, "" if none.
std::string error_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}
std::string yaml_error(const std::string& text) {
  return error_of([&] { parse_yaml(text, "f.yaml"); });
}
std::string json_error(const std::string& text, int line = 1) {
  return error_of([&] { parse_json(text, "f.json", line); });
}

/// The same tree, places aside.
bool same(const Node& a, const Node& b) {
  if (a.kind != b.kind || a.text != b.text || a.quoted != b.quoted) return false;
  if (a.items.size() != b.items.size() || a.members.size() != b.members.size()) return false;
  for (size_t i = 0; i < a.items.size(); ++i)
    if (!same(a.items[i], b.items[i])) return false;
  for (size_t i = 0; i < a.members.size(); ++i)
    if (a.members[i].first != b.members[i].first || !same(a.members[i].second, b.members[i].second))
      return false;
  return true;
}

/// What a tree of JSON says, whichever of the two readers made it: numbers to the last bit, texts,
/// lines; columns aside.
std::string meaning(const Node& node) {
  const auto number = [](double value) {
    char hex[40];
    std::snprintf(hex, sizeof hex, "%a", value);
    return std::string(hex);
  };
  std::string out = std::to_string(node.line) + ":";
  switch (node.kind) {
    case Node::Kind::null:
      return out + "null";
    case Node::Kind::scalar: {
      if (node.quoted) return out + "\"" + node.text + "\"";
      const std::string path = "f.json";
      const bool word = node.text == "true" || node.text == "false";
      return out + (word ? node.text : number(top(node, path).number()));
    }
    case Node::Kind::mapping:
      for (const auto& [key, value] : node.members) out += key + "=" + meaning(value) + " ";
      return out + "}";
    default:
      break;
  }
  const std::string head = out;
  for (const Node& item : node.items) out += meaning(item) + " ";
  for (size_t i = 0; i < node.numbers.size(); ++i) {
    const size_t columns = node.columns;
    if (columns > 0 && i % columns == 0) out += head;
    out += head + number(node.numbers[i]) + " ";
    if (columns > 0 && i % columns == columns - 1) out += "] ";
  }
  return out + "]";
}

double yaml_number(const std::string& scalar) {
  const std::string path = "f.yaml";
  const Node node = parse_yaml("x: " + scalar, path);
  return top(node, path)["x"].number();
}

}  // namespace

TEST_CASE("YAML becomes a tree with places, order and quoting", "[document]") {
  const Node node = parse_yaml(
      "# comment\nb: [1, \"2\", three]\na:\n  x: ~\n  'y z': &p {k: v}\n  w: *p\n\n", "f.yaml");
  REQUIRE(node.kind == Node::Kind::mapping);
  REQUIRE(node.members.size() == 2);
  CHECK(node.members[0].first == "b");
  const Node& b = *node.find("b");
  CHECK(b.line == 2);
  CHECK(b.items[0].column == 5);
  CHECK_FALSE(b.items[0].quoted);
  CHECK(b.items[1].quoted);
  CHECK(b.items[1].text == "2");
  const Node& a = *node.find("a");
  CHECK(a.line == 3);  // of its key: messages about a block point there
  CHECK(a.find("x")->kind == Node::Kind::null);
  CHECK(a.find("w")->find("k")->text == "v");
  CHECK(a.find("w")->line == 6);
  CHECK(a.find("nothing") == nullptr);
  CHECK(parse_yaml("", "f.yaml").kind == Node::Kind::null);
  CHECK(parse_yaml("--- a\n...\n", "f.yaml").text == "a");
  CHECK(parse_yaml("a: |\n  text\n", "f.yaml").find("a")->text == "text\n");
}

TEST_CASE("malformed YAML is refused with its place", "[document]") {
  CHECK_THAT(yaml_error("a: 1\nb: [1, 2\n"),
             Contains("f.yaml:3:1: end of sequence flow not found"));
  CHECK_THAT(yaml_error("a: b: c\n"), Contains("f.yaml:1:5: "));
  CHECK_THAT(yaml_error("a: *b\n"), Contains("f.yaml:1:4: "));
  CHECK_THAT(yaml_error("a: \"open\n"),
             Contains("a quoted text is not closed"));  // yaml-cpp by itself takes this
  CHECK_THAT(yaml_error("a: 1\nb:\n  c: 1\n  d: 2\n  c: 3\n"),
             Contains("f.yaml:5:6: key 'c' occurs twice"));
  CHECK_THAT(yaml_error("a: 1\n\"a\": 2\n"), Contains("f.yaml:2:6: key 'a' occurs twice"));
  CHECK_THAT(yaml_error("--- a\n--- b\n"), Contains("f.yaml:2:5: a second document"));
  CHECK_THAT(yaml_error("a: !!binary xyz\n"), Contains("f.yaml:1:4: the tag"));
  CHECK_THAT(yaml_error("~: 1\n"), Contains("a key must be"));
  CHECK_THAT(yaml_error("[a, b]: 1\n"), Contains("a key must be"));
}

TEST_CASE("hostile YAML and JSON end in an error, not in the memory", "[document]") {
  std::string laughs = "a0: &a0 [ha, ha, ha, ha, ha, ha, ha, ha, ha]\n";
  for (int i = 1; i < 12; ++i) {
    const std::string name = "a" + std::to_string(i), before = "*a" + std::to_string(i - 1);
    laughs += name + ": &" + name + " [" + before;
    for (int k = 0; k < 8; ++k) laughs += ", " + before;
    laughs += "]\n";
  }
  CHECK_THAT(yaml_error(laughs), Contains("f.yaml:5:5: anchors and aliases hold more than"));
  CHECK_THAT(yaml_error("a: &x [*x]\n"),
             Contains("f.yaml:1:8: an alias to something that contains it"));
  std::string deep;
  for (int i = 0; i < 2000; ++i) deep += std::string(i, ' ') + "a:\n";
  CHECK_THAT(yaml_error(deep), Contains("nested more than"));
  CHECK_FALSE(yaml_error(std::string(100'000, '[')).empty());
  CHECK_FALSE(yaml_error(std::string(100'000, '{')).empty());
  CHECK_THAT(json_error(std::string(100'000, '[')), Contains("f.json:1:101: nested more than"));
}

TEST_CASE("JSON becomes a tree with places, its numbers keep their value", "[document]") {
  const Node node = parse_json(
      "{\"s\": \"a\\\"\\n\\u00e9\",\n \"n\": [1, -2.50, 1e-5,\n 18446744073709551615],\n\"t\": "
      "true, "
      "\"o\": {\n\"z\": null}}",
      "f.json", 10);
  CHECK(node.find("s")->text == "a\"\n\xc3\xa9");
  CHECK(node.find("s")->quoted);
  const Node& n = *node.find("n");
  CHECK(n.line == 11);
  CHECK(n.items[1].text == "-2.5");
  CHECK(n.items[3].line == 12);
  CHECK(n.items[3].column == 2);
  CHECK(n.items[3].text == "18446744073709551615");
  CHECK(node.find("t")->text == "true");
  CHECK_FALSE(node.find("t")->quoted);
  CHECK(node.find("o")->find("z")->line == 14);
  CHECK(node.find("o")->find("z")->column == 6);
  for (double value :
       {0.1, 1 / 3.0, 5e-324, 1.7976931348623157e308, -123456789.123456789, 4503599627370497.5}) {
    char text[64];
    std::snprintf(text, sizeof text, "[%.17g]", value);
    const std::string read = parse_json(text, "f.json").items[0].text;
    double back = 0;
    std::from_chars(read.data(), read.data() + read.size(), back);
    CHECK(back == value);
  }
}

TEST_CASE("plain JSON means what JSON means, or is refused", "[document]") {
  struct Line {
    std::string text;
    bool taken;  // by parse_plain_json()
  };
  const std::string digits(5000, '7'), deep = std::string(15, '[') + "1" + std::string(15, ']');
  const std::vector<Line> lines = {
      {R"({"id": "a", "n": [1, -2.5, 3e2], "m": [[1, 2], [3, 4]], "t": true, "f": false, "z": null, "e": [], "o": {}})",
       true},
      {"\t{ \"a\" :\r1 , \"b\":[ 1 ,2 ] , \"c\":[ [ 1 ] , [ 2 ] ] , \"d\" : [ ] , \"e\" : [ [ ] ] "
       "} \r",
       true},
      {"[0, -0, -0.0, 0e5, 1E+3, 1e-3, 100000, 123456789012345678, 12345678901234567890, 3.0]",
       true},
      {"[4.9406564584124654e-324, 1.7976931348623157e308, 0.1, 2.2250738585072011e-308, "
       "9007199254740993, 0.3e1, 1e22, 1e23]",
       true},
      {"[[[1, 2], [3, 4]], [[5, 6], [7, 8]]]", true},
      {"[\"a\", \"\", {\"a\": [1]}, [\"b\"], null]", true},
      {"[{\"a\": -0}, {\"a\": -0.0}, {\"a\": 12345678901234567890123}, {\"a\": 1e5}, {\"a\": 3.0}]",
       true},
      {"0." + digits, true},
      {deep, true},
      {"[\"" + std::string(100'000, 'x') + "\"]", true},
      {"true", true},
      // rare, left to parse_json()
      {R"(["\"", "\u00e9", "\n", "\/"])", false},
      {"[\"\xc3\xa9\"]", false},
      {"[\"\x7f\"]", false},
      {"[1, \"a\"]", false},
      {"[[1, 2], [3]]", false},
      {"[[1], 2]", false},
      {"[[1], []]", false},
      {"[1e-400]", false},
      {std::string(50, '[') + std::string(50, ']'), false},
      {"[1,\n2]", false},
      // wrong
      {"\xef\xbb\xbf{}", false},  // (a byte order mark, which nlohmann takes)
      {"[1e400]", false},
      {"[" + digits + "]", false},
      {"{\"a\": 1, \"b\": 2, \"a\": 3}", false},
      {"[{\"a\": 1, \"a\": 1}]", false},
      {"{} x", false},
      {"[1]]", false},
      {"[1,]", false},
      {"[,1]", false},
      {"[[1],]", false},
      {"{\"a\": 1,}", false},
      {"{\"a\"}", false},
      {"{a: 1}", false},
      {"{\"a\" 1}", false},
      {"[1 2]", false},
      {"[01]", false},
      {"[-01]", false},
      {"[1.]", false},
      {"[1.e5]", false},
      {"[.5]", false},
      {"[-.5]", false},
      {"[+1]", false},
      {"[--1]", false},
      {"[1e]", false},
      {"[1e+]", false},
      {"[0x10]", false},
      {"[NaN]", false},
      {"[nan]", false},
      {"[-inf]", false},
      {"[Infinity]", false},
      {"[truex]", false},
      {"[tru]", false},
      {"nul", false},
      {"[\"a]", false},
      {"[\"a\tb\"]", false},
      {"[1\f]", false},
      {std::string("[1\0]", 4), false},
      {"[", false},
      {"{", false},
      {"", false},
      {"-", false}};
  for (const Line& line : lines) {
    INFO(line.text.substr(0, 200));
    Node node;
    CHECK(parse_plain_json(line.text, 7, node) == line.taken);
    if (line.taken) CHECK(meaning(node) == meaning(parse_json(line.text, "f.json", 7)));
  }
}

TEST_CASE("plain JSON with a mistake somewhere: nothing is taken that JSON refuses", "[document]") {
  const std::string good =
      R"({"id": "a_1", "t": 12.25, "j": {"b": -0.5, "c": 1e-3}, "v": [{"s": "x", "p": [[1, 2.5], [-3, 4]], "i": [0, 12]}], )"
      R"("c": [[[2, 1], [1, 2]]], "f": false, "n": null})";
  const std::string odd = "\"\\{}[],:.-+eE0129 \t\r\n\x01\x80truefalsn";
  const char* more = std::getenv("KINCAL_MUTATIONS");  // scripts/test-all asks for more
  const int trials = more ? std::atoi(more) : 30'000;
  std::mt19937 random(1);
  int taken = 0;
  for (int trial = 0; trial < trials; ++trial) {
    std::string text = good;
    for (int change = trial % 3; change >= 0; --change) {
      const size_t at = random() % text.size();
      const char c = odd[random() % odd.size()];
      switch (random() % 3) {
        case 0:
          text[at] = c;
          break;
        case 1:
          text.insert(at, 1, c);
          break;
        default:
          text.erase(at, 1 + random() % 3);
      }
    }
    Node node;
    if (!parse_plain_json(text, 1, node)) continue;
    ++taken;
    const std::string error = json_error(text);
    if (error.empty() && meaning(node) == meaning(parse_json(text, "f.json"))) continue;
    INFO(text);
    FAIL_CHECK("taken, but " << (error.empty() ? "it means something else" : error));
  }
  CHECK(taken > trials / 15);
}

TEST_CASE("malformed JSON is refused with its place", "[document]") {
  CHECK_THAT(json_error("{\"a\": [1,2}", 7),
             Contains("f.json:7:11: syntax error while parsing array - unexpected '}'"));
  CHECK_THAT(json_error("{\"a\": 1,\n \"b\": NaN}", 7),
             Contains("f.json:8:7: ") && Contains("finite numbers only"));
  CHECK_THAT(json_error("[Infinity]"), Contains("f.json:1:2: ") && Contains("finite numbers only"));
  CHECK_THAT(json_error("[-Infinity]"),
             Contains("f.json:1:3: ") && Contains("finite numbers only"));
  CHECK_THAT(json_error("[1e400]"), Contains("f.json:1:6: number overflow parsing '1e400'"));
  CHECK_THAT(json_error("{\"a\": 1, \"b\": 2, \"a\": 3}"),
             Contains("f.json:1:23: key 'a' occurs twice"));
  CHECK_THAT(json_error("{\"a\": 1} x"), Contains("expected end of input"));
  CHECK_THAT(json_error("[\"\xff\"]"), Contains("UTF-8"));
  CHECK_FALSE(json_error("").empty());
}

TEST_CASE("numbers: what is taken and what is not", "[document]") {
  CHECK(yaml_number("1e-5") == 1e-5);
  CHECK(yaml_number(".5") == 0.5);
  CHECK(yaml_number("+5.") == 5);
  CHECK(yaml_number("-0.25E+2") == -25);
  CHECK(yaml_number("0") == 0);
  for (const char* bad : {"nan", ".nan", "inf", "-.inf", "0x10", "010", "0o17", "1_000", "1:30",
                          "1,5", "1 2", "1e400", "abc", "true", "\"1.5\"", "+-1", "''", "1.5m"}) {
    INFO(bad);
    CHECK_THAT(error_of([&] { yaml_number(bad); }),
               Contains("f.yaml:1: x: a finite number is expected, not '"));
  }
  CHECK_THAT(error_of([] { yaml_number("abc"); }), Contains("not 'abc'"));
  CHECK_THAT(error_of([] { yaml_number("[1]"); }), Contains("not a list"));
  CHECK_THAT(error_of([] { yaml_number("{}"); }), Contains("not a mapping"));
  CHECK_THAT(error_of([] { yaml_number(""); }), Contains("not nothing"));
}

TEST_CASE("fields check types and tell where", "[document]") {
  const std::string path = "rig.yaml";
  const Node node = parse_yaml(
      "camera:\n  sigma: -1\n  size: [640, 480.5]\n  on: yes\n  ok: true\n  names: [a, [b]]\n"
      "  flat: [1, 2]\n  rows: [[1, 2], [3]]\n  table: [[1, 2], [3, 4]]\n  big: 12\n  id: 007\n",
      path);
  const Field all = top(node, path), camera = all["camera"];
  const auto fails = [](const std::function<void()>& f, const std::string& text) {
    CHECK_THAT(error_of(f), Contains(text));
  };
  CHECK(camera.where() == "rig.yaml:1: camera");
  fails([&] { camera["sigma"].positive(); },
        "rig.yaml:2: camera.sigma: a number greater than 0 is expected, not '-1'");
  fails([&] { camera["sigma"].number_at_least(0); },
        "rig.yaml:2: camera.sigma: a number of at least 0 is expected");
  fails([&] { camera["size"].item(1).integer(1, 9999); },
        "rig.yaml:3: camera.size[1]: an integer in 1 .. 9999 is expected, not '480.5'");
  fails([&] { camera["on"].boolean(); },
        "rig.yaml:4: camera.on: true or false is expected, not 'yes'");
  CHECK(camera["ok"].boolean());
  fails([&] { camera["names"].strings(); },
        "rig.yaml:6: camera.names[1]: a text is expected, not a list");
  fails([&] { camera["flat"].vector(3); },
        "rig.yaml:7: camera.flat: a list of 3 numbers is expected, not a list of 2");
  fails([&] { camera["flat"].table(2); },
        "rig.yaml:7: camera.flat[0]: a list of 2 numbers is expected, not '1'");
  fails([&] { camera["rows"].table(2); },
        "rig.yaml:8: camera.rows[1]: a list of 2 numbers is expected, not a list of 1");
  CHECK(camera["table"].table(2) == std::vector<double>{1, 2, 3, 4});
  CHECK(camera["big"].integer(12, 12) == 12);
  fails([&] { camera["id"].integer(0, 9); },
        "camera.id: an integer in 0 .. 9 is expected, not '007'");
  CHECK(camera["id"].string() == "007");
  fails([&] { camera["missing"]; }, "rig.yaml:1: camera: key 'missing' is missing");
  fails([&] { all.check_keys({"camera", "robot"}); }, "rig.yaml:1: key 'robot' is missing");
  fails([&] { all.check_keys({"cameras"}); }, "rig.yaml:1: unknown key 'camera'; nearest: cameras");
  fails([&] { all.check_keys({"xyz"}, {"rpy"}); },
        "rig.yaml:1: unknown key 'camera'; valid: xyz, rpy");
  fails([&] { camera["flat"].check_keys({}); },
        "rig.yaml:7: camera.flat: a mapping is expected, not a list");
}

TEST_CASE("poses are xyz with rpy or a unit quaternion", "[document]") {
  const std::string path = "p.yaml";
  const auto pose = [&](const std::string& text) {
    const Node node = parse_yaml("pose: " + text, path);
    return top(node, path)["pose"].pose();
  };
  CHECK(pose("{}").rotation == Matrix3d::Identity());
  CHECK(pose("{xyz: [1, 2, 3]}").translation == Vector3d(1, 2, 3));
  // a quarter turn about z takes x to y; quaternions are x y z w
  CHECK((pose("{rpy: [0, 0, 1.5707963267948966]}") * Vector3d::UnitX() - Vector3d::UnitY()).norm() <
        1e-15);
  CHECK((pose("{quat: [0, 0, 0.70710678118654752, 0.70710678118654752]}") * Vector3d::UnitX() -
         Vector3d::UnitY())
            .norm() < 1e-15);
  CHECK_THAT(error_of([&] { pose("{quat: [0, 0, 0, 1.01]}"); }),
             Contains("p.yaml:1: pose.quat: a unit quaternion"));
  CHECK_THAT(error_of([&] { pose("{quat: [0, 0, 1]}"); }),
             Contains("p.yaml:1: pose.quat: a list of 4 numbers"));
  CHECK_THAT(error_of([&] { pose("{rpy: [0, 0, 0], quat: [0, 0, 0, 1]}"); }),
             Contains("p.yaml:1: pose: either rpy or quat"));
  CHECK_THAT(error_of([&] { pose("{xzy: [0, 0, 0]}"); }),
             Contains("p.yaml:1: pose: unknown key 'xzy'; nearest: xyz"));
}

TEST_CASE("the nearest names are those meant", "[document]") {
  const std::vector<std::string> names = {
      "shoulder_pan_joint", "shoulder_lift_joint", "l_elbow_flex_joint", "head_pan_joint",
      "head_tilt_joint",    "l_wrist_roll_joint",  "r_wrist_roll_joint", "a"};
  CHECK_THAT(nearest_names("shoulder_pan_jiont", names),
             Catch::StartsWith("; nearest: shoulder_pan_joint"));
  CHECK(nearest_names("l_elbw_*", names) ==
        "; nearest: l_elbow_flex_joint");  // a glob by its letters
  CHECK(nearest_names("*_wrst_*", names) == "; nearest: l_wrist_roll_joint, r_wrist_roll_joint");
  CHECK(nearest_names("head_pan", names) == "; nearest: head_pan_joint");
  CHECK_THAT(nearest_names("Head_Tilt_Joint", names),
             Catch::StartsWith("; nearest: head_tilt_joint"));
  CHECK(nearest_names("camera", names).empty());
  CHECK(nearest_names("b", names).empty());
  CHECK(nearest_names("", names).empty());
  CHECK(nearest_names(std::string(100'000, 'x'), names).empty());
  CHECK(nearest_names("j1", {"j11", "j12", "j13", "j14", "j15"}) ==
        "; nearest: j11, j12, j13, j14");
}

TEST_CASE("prefixes, case and what stands between words do not hide a name", "[document]") {
  const std::vector<std::string> joints = {"joint_1", "joint_2", "joint_3", "tool"};
  CHECK(nearest_names("Joint2", joints) == "; nearest: joint_2");
  CHECK(nearest_names("JOINT-2", joints) == "; nearest: joint_2");
  CHECK_THAT(nearest_names("robot1_joint_2", joints), Catch::StartsWith("; nearest: joint_2"));
  CHECK_THAT(nearest_names("robot1/joint2", joints), Catch::StartsWith("; nearest: joint_2"));
  CHECK_THAT(nearest_names("left_arm_jiont_2", joints), Catch::StartsWith("; nearest: joint_2"));
  CHECK(nearest_names("arm_l6", {"l5", "l6"}) == "; nearest: l6");
  CHECK(nearest_names("joint_2", {"iiwa7_joint_1", "iiwa7_joint_2", "iiwa7_link_2"}) ==
        "; nearest: iiwa7_joint_2, iiwa7_joint_1");
  CHECK_THAT(nearest_names("shoulder", {"ur5_Shoulder", "elbow"}),
             Catch::StartsWith("; nearest: ur5_Shoulder"));
  const std::vector<std::string> parameters = {"joint/j1/offset", "joint/j2/offset",
                                               "joint/j2/origin", "sensor/cam/pose"};
  CHECK(nearest_names("j2", parameters) == "; nearest: joint/j2/offset, joint/j2/origin");
  CHECK(nearest_names("offset/j2", parameters) == "; nearest: joint/j2/offset");
  CHECK_THAT(nearest_names("J2.offset", parameters),
             Catch::StartsWith("; nearest: joint/j2/offset"));
  CHECK(nearest_names("laser", joints).empty());
  CHECK(nearest_names("2", joints).empty());
  CHECK(nearest_names("a_1", joints).empty());
  CHECK(nearest_or_all("laser", joints, "the robot has") ==
        "; the robot has: joint_1, joint_2, joint_3, tool");
  CHECK(nearest_or_all("Joint2", joints, "the robot has") == "; nearest: joint_2");
  CHECK_THAT(nearest_or_all("laser", std::vector<std::string>(30, "xyz"), "there are"),
             Catch::EndsWith("xyz and 10 more"));
  CHECK(nearest_or_all("laser", {}, "there are").empty());
}

TEST_CASE("shortest is exact and short", "[document]") {
  CHECK(shortest(0.1) == "0.1");
  CHECK(shortest(-0.0) == "0");
  CHECK(shortest(3) == "3");
  CHECK(shortest(1 / 3.0) == "0.3333333333333333");
  CHECK(yaml_number(shortest(-5e-324)) == -5e-324);
}

TEST_CASE("YAML is written so that it reads back as the same tree", "[document]") {
  const std::string text = R"(
plain: some text
number: -1.5e-3
quoted: "1.5"
nothing: ~
empty_text: ''
list: [1, two, "three, four", "*"]
empty: []
none: {}
odd: [a b, "#x", "x: y", "- z", "null", "é", "tab\there", "line\nbreak", "\x01", "back\\slash"]
colon: a:b/c#d
"key: odd": {"*": 1}
"null": x
"": y
points: [[0, 0, 0], [0.05, 1e-9, -3]]
nested: [[1, [2, 3]], {a: 1, b: {c: [1, 2]}}, [], {}, ~]
small: {a: 1, b: [1, 2], c: x}
deep: {a: {b: {c: {d: 1, e: [x]}}}}
steps:
  - step: one
    free: [aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa, bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb, ccccccccccccccccccccccccc]
  - {step: two, loss: {huber: 3}}
)";
  const Node node = parse_yaml(text, "f.yaml");
  const std::string written = to_yaml(node);
  INFO(written);
  CHECK(same(node, parse_yaml(written, "g.yaml")));
  CHECK(to_yaml(parse_yaml(written, "g.yaml")) == written);
  CHECK_THAT(written, Contains("small: {a: 1, b: [1, 2], c: x}\n") &&
                          Contains("points:\n  - [0, 0, 0]\n  - [0.05, 1e-9, -3]\n") &&
                          Contains("  - step: one\n    free:\n      - aaaaa"));
  // trees that no YAML file gave: strings of a program that would mean something else without
  // quotes
  for (const char* odd :
       {"",   "~",  "null", "# x", "a: b", "a:", "- x",  "-",  "[x", " x", "x ",   "&x",  "*x",
        "!x", "%x", "@x",   "...", "---",  "?",  "a #b", "\"", "'",  "\\", "a\nb", "\x7f"}) {
    INFO(odd);
    Node scalar, list;
    scalar.kind = Node::Kind::scalar;
    scalar.text = odd;
    list.kind = Node::Kind::mapping;
    list.members = {{odd, scalar}, {"list", Node()}};
    list.members[1].second.kind = Node::Kind::sequence;
    list.members[1].second.items = {scalar, scalar};
    const Node back = parse_yaml(to_yaml(list), "f.yaml");
    CHECK(back.members[0].first == odd);
    CHECK(back.members[0].second.text == odd);
    CHECK(back.members[0].second.kind == Node::Kind::scalar);
    CHECK(back.members[1].second.items[1].text == odd);
  }
}

TEST_CASE("names that no reader may misread are written in quotes", "[document]") {
  const std::vector<std::string> names = {"joint/j?/offset",
                                          "?",
                                          "a: b",
                                          "a #b",
                                          "{x}",
                                          "line\xe2\x80\xa8"
                                          "end",
                                          "next\xc2\x85"
                                          "l",
                                          "\xef\xbb\xbfmark",
                                          "c1\xc2\x9f",
                                          "no\xef\xbf\xbe"
                                          "character",
                                          "tab\there",
                                          "\x7f",
                                          "\xc3\xa9t\xc3\xa9",
                                          "e\xe2\x80\xa6"};
  Node list, mapping, all;
  list.kind = Node::Kind::sequence;
  mapping.kind = all.kind = Node::Kind::mapping;
  for (const std::string& name : names) {
    list.items.push_back(scalar_node(name));
    list.items.back().quoted = true;
    Node one;
    one.kind = Node::Kind::mapping;
    one.members.push_back({name, list.items.back()});
    mapping.members.push_back({name, one});
  }
  all.members = {{"list", list}, {"mapping", mapping}, {"flow", mapping.members[0].second}};
  const std::string text = to_yaml(all);
  CHECK(same(parse_yaml(text, "f.yaml"), all));
  for (const Node& item : list.items) {  // as free: names there keep no quotes of their own
    Node plain = list;
    plain.items = {scalar_node(item.text)};
    CHECK(parse_yaml(to_yaml(plain), "f.yaml").items.at(0).text == item.text);
  }
  // What YAML 1.1 takes as the end of a line, or does not take, stands as an escape.
  for (const char* raw :
       {"\xe2\x80\xa8", "\xc2\x85", "\xef\xbb\xbf", "\xc2\x9f", "\xef\xbf\xbe", "\x7f"})
    CHECK(text.find(raw) == std::string::npos);
  CHECK_THAT(text, Contains("\\u2028") && Contains("\\x85") && Contains("\\ufeff"));
  CHECK_THAT(text, Contains("\xc3\xa9t\xc3\xa9") && Contains("e\xe2\x80\xa6"));  // these stay
}

TEST_CASE("names that readers of YAML take for something else are written in quotes",
          "[document]") {
  // Truth values, nothing, whole numbers (of base 2, 8, 10, 16, 60), others, dates: YAML 1.1
  // or 1.2.
  for (const std::string name :
       {"yes",   "No",         "y",          "N",    "on",  "OFF",  "true",  "False",
        "null",  "NULL",       "0x10",       "0o17", "017", "0b11", "1e5",   "12",
        "-3",    "+1",         "1_000",      "1.5",  ".5",  ".inf", "-.Inf", ".nan",
        "12:30", "2001-01-31", "685_230.15", "=",    "<<",  "~"}) {
    INFO(name);
    const std::string quoted = "\"" + name + "\"";
    Node inner, outer;
    inner.kind = outer.kind = Node::Kind::mapping;
    inner.members = {{name, scalar_node("1")}};
    outer.members = {{name, inner}};  // as a key of a block and of a line
    CHECK(to_yaml(outer) == quoted + ": {" + quoted + ": 1}\n");
    CHECK(yaml_text(name) == quoted);
  }
  for (const std::string name : {"left", "joint/j1/offset", "Yes_camera", "n1", "e5", "_1", "x0x10",
                                 "../arm.urdf", "-x", "+a", "yes no", "\xc3\xa9t\xc3\xa9"}) {
    INFO(name);
    CHECK(yaml_text(name) == name);
  }
  // In a list or mapping of one line too.
  for (const std::string name : {"a,b", "a]", "{a", "a:b"}) {
    INFO(name);
    const Node back = parse_yaml("[" + yaml_text(name) + ", " + yaml_text("c") + "]", "f.yaml");
    REQUIRE(back.items.size() == 2);
    CHECK(back.items[0].text == name);
  }
  CHECK(to_yaml(parse_yaml("yes: no", "f.yaml")) == "\"yes\": no\n");  // of values the file decides
}

TEST_CASE("keys of YAML are as long as they can be written", "[document]") {
  CHECK(yaml_error(std::string(250, 'k') + ": 1") == "");
  CHECK_THAT(yaml_error(std::string(251, 'k') + ": 1"),
             Contains("f.yaml:1:1: ") && Contains("251 bytes"));
}

TEST_CASE("a list in place of a mapping, and less than expected, are errors", "[document]") {
  const std::string path = "f.json";
  const Node node = parse_json(R"({"list": [1, "a"], "map": {"k": 1}})", path);
  const Field all = top(node, path);
  CHECK(all["map"].members().size() == 1);
  CHECK_THAT(error_of([&] { all["list"].members(); }),
             Contains("f.json:1: list: a mapping is expected, not a list"));
  CHECK_THAT(error_of([&] { all["list"].item(2); }), Contains("f.json:1: list: "));
  CHECK_THAT(error_of([&] { all["map"].item(0); }), Contains("f.json:1: map: "));
}

TEST_CASE("a decimal comma of the user's locale changes nothing", "[document]") {
  const DecimalComma comma;
  if (!comma.c_too) WARN("no locale with a decimal comma for C on this machine: C++ streams only");
  CHECK(yaml_number("1.5") == 1.5);
  CHECK_THAT(error_of([] { yaml_number("1,5"); }),
             Contains("a finite number is expected, not '1,5'"));
  CHECK(parse_json("[1.5, 1234567.25]", "f.json").items[1].text == "1234567.25");
  CHECK(shortest(1234567.25) == "1234567.25");
  CHECK(to_yaml(parse_yaml("a: [1.5]", "f.yaml")) == "a: [1.5]\n");
  CHECK_THAT(json_error("[1,]", 12345), Contains("f.json:12345:4: "));
  CHECK_THAT(yaml_error(std::string(2000, '\n') + "a: [1\n"), Contains("f.yaml:2002:"));
}

TEST_CASE("files that cannot be read say why", "[document]") {
  CHECK_THAT(error_of([] { read_file("no/such/file.yaml"); }),
             Contains("no/such/file.yaml: cannot be read: No such file"));
  CHECK_THAT(error_of([] { read_file("."); }), Contains(".: cannot be read: is a directory"));
}

}  // namespace document_test
