// Stands for libFuzzer where there is none: gives a reader (fuzz.cpp) its corpus, and for some
// seconds (KINCAL_FUZZ_SECONDS, default 4) the same with mistakes, the same ones in every run. The
// last text stands in last-READER in the working directory.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "../../io/document/files.h"
#include "fuzz.h"

namespace {

const std::vector<std::string> kWords = {"0",
                                         "-1",
                                         "1e308",
                                         "1e-320",
                                         "nan",
                                         "\"\"",
                                         "null",
                                         "[]",
                                         "{}",
                                         "[[]]",
                                         "~",
                                         "'",
                                         "\"",
                                         ":",
                                         "- ",
                                         "\n",
                                         "\t",
                                         "&a ",
                                         "*a",
                                         "${x}",
                                         "!!x ",
                                         "\xff",
                                         "<a/>",
                                         "2e9",
                                         "0x10",
                                         ",",
                                         "true",
                                         "*",
                                         "?",
                                         "[[0, 0, 0]]",
                                         "xyz: [0, 0, 0]",
                                         "---\n",
                                         "\r\n",
                                         "&#0;",
                                         "\\u0000",
                                         " ",
                                         "free",
                                         "0 0 0",
                                         "999999999999",
                                         "\xe2\x80\xa8"};

class Mutations {
 public:
  explicit Mutations(const std::vector<std::string>& seeds) : seeds_(seeds) {}

  std::string next() {
    std::string text = seeds_[below(seeds_.size())];
    for (size_t n = 1 + below(4); n > 0; --n) change(text);
    return text;
  }

 private:
  size_t below(size_t end) { return end == 0 ? 0 : random_() % end; }

  /// A word or number of the text: what lies between two separators.
  std::pair<size_t, size_t> token(const std::string& text) {
    static const char kSeparators[] = " \n\t,:[]{}<>\"'=/";
    const size_t at = text.find_first_not_of(kSeparators, below(text.size() + 1));
    if (at == std::string::npos) return {0, 0};
    const size_t end = text.find_first_of(kSeparators, at);
    return {at, (end == std::string::npos ? text.size() : end) - at};
  }

  void change(std::string& text) {
    const size_t at = below(text.size() + 1), length = below(20);
    const auto [begin, size] = token(text);
    switch (below(7)) {
      case 0:
        return static_cast<void>(text.erase(at, length));
      case 1:
        return static_cast<void>(text.insert(at, kWords[below(kWords.size())]));
      case 2:
        return static_cast<void>(text.insert(at, text.substr(below(text.size() + 1), 10 * length)));
      case 3:
        return static_cast<void>(text.resize(at));
      case 4:
        return static_cast<void>(text.replace(begin, size, kWords[below(kWords.size())]));
      case 5: {
        const auto [other, other_size] = token(text);
        return static_cast<void>(text.replace(begin, size, text.substr(other, other_size)));
      }
      default:
        if (at < text.size()) text[at] = static_cast<char>(below(256));
    }
  }

  std::vector<std::string> seeds_;
  std::mt19937 random_{1};
};

}  // namespace

int main() {
  const std::string reader = std::getenv("KINCAL_READER") ? std::getenv("KINCAL_READER") : "";
  const char* const seconds = std::getenv("KINCAL_FUZZ_SECONDS");
  const std::string last = "last-" + reader;
  size_t texts = 0;
  const auto give = [&](const std::string& text) {
    std::ofstream(last, std::ios::binary) << text;
    ++texts;
    return is_read(text);
  };
  std::vector<std::string> paths, seeds;
  for (const auto& entry : std::filesystem::directory_iterator(KINCAL_FUZZ_CORPUS "/" + reader))
    paths.push_back(entry.path().string());
  std::sort(paths.begin(), paths.end());
  for (const std::string& path : paths)
    if (!give(seeds.emplace_back(kincal::read_file(path)))) {
      std::fprintf(stderr, "%s is refused\n", path.c_str());
      return 1;
    }
  Mutations mutations(seeds);
  const auto end =
      std::chrono::steady_clock::now() + std::chrono::seconds(seconds ? std::atoi(seconds) : 4);
  while (std::chrono::steady_clock::now() < end) give(mutations.next());
  std::filesystem::remove(last);
  std::printf("%s: %zu texts\n", reader.c_str(), texts);
}
