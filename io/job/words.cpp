#include "words.h"

#include <algorithm>
#include <regex>

#include "../document/names.h"

namespace kincal {

std::string option_name(const std::string& keyword, Words words) {
  if (words == Words::keywords) return keyword;
  std::string out = "--" + keyword;
  for (char& c : out)
    if (c == '_') c = '-';
  return out;
}

std::string in_words(std::string message, Words words) {
  // Places in the library's options, as "free[2]".
  for (const char* option : {"free", "fix", "group", "no_group", "spread"}) {
    const size_t end = message.find(']');
    if (words == Words::switches && message.rfind(std::string(option) + "[", 0) == 0 &&
        end != std::string::npos)
      message.replace(0, end + 1, option_name(option, words));
  }
  if (message.rfind("last_step", 0) == 0) message.replace(0, 9, option_name("step", words));
  // Options of the library that a text names, as "`fix`".
  const auto replace = [&](const std::string& mark, const std::string& by) {
    for (size_t at; (at = message.find(mark)) != std::string::npos;)
      message.replace(at, mark.size(), by);
  };
  for (const char* option : {"free", "fix", "group", "no_group", "reject", "estimate_noise"})
    replace("`" + std::string(option) + "`", option_name(option, words));
  replace("`check`", words == Words::switches ? "kincal check" : "kincal.check()");
  return message;
}

void in_words(Notice& notice, Words words) {
  for (std::string* text : {&notice.what, &notice.why, &notice.cure, &notice.otherwise})
    *text = in_words(std::move(*text), words);
}

Place place_of(const std::string& message) {
  constexpr size_t kLongest = 1000;  // the expressions recur over what they read
  static const std::regex place("(.+?):([0-9]{1,9})(?::[0-9]+)?: (?:([^\\s:]+): )?");
  static const std::regex name(
      "([a-z_]+(?:(?:\\[[0-9]+\\])+\\.\\S+)?)(?:\\[[0-9]+\\])?(?: '.*?')?: ");
  static const std::regex file("([^:]*[./][^:\\[]*): ");
  const std::string line = message.substr(0, std::min(message.find('\n'), kLongest));
  const auto begins = [&](const std::regex& expression, std::smatch& found) {
    return std::regex_search(line, found, expression, std::regex_constants::match_continuous);
  };
  std::smatch found;
  if (begins(place, found)) return {found[1], std::stoi(found[2]), found[3]};
  if (begins(name, found)) return {"", 0, found[1]};
  if (begins(file, found)) return {found[1], 0, ""};
  return {};
}

InputError with_nearest(const NameError& error, Words words) {
  const std::string what = in_words(error.what(), words),
                    near = nearest_names(error.name, error.valid);
  if (!near.empty() || what.find("matches no parameter") == std::string::npos)
    return InputError(what +
                      (near.empty() ? nearest_or_all(error.name, error.valid, "there are") : near));
  return InputError(
      what +
      "; parameters are called joint/NAME/offset, /scale or /origin, sensor/NAME/pose, "
      "/intrinsics, /distortion or /baseline, target/NAME/pose, /square or /points, "
      "and * stands for anything");
}

}  // namespace kincal
