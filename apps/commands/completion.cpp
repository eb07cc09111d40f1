// `kincal completion bash`: what a shell needs to complete kincal's commands and options, made from
// the program's own.
#include <iostream>

#include "command.h"

namespace kincal {
namespace {

/// What stands between the braces of a choice's type, "TEXT:{latent,marginal}", as words.
std::string choices(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::string::size_type begin = type.find('{'), end = type.find('}');
  if (begin == std::string::npos || end == std::string::npos) return "";
  std::string out = type.substr(begin + 1, end - begin - 1);
  for (char& c : out)
    if (c == ',') c = ' ';
  return out;
}

/// The names of a command's options, and its case of what follows each of them.
void add_options(const CLI::App& command, std::string& names, std::string& cases) {
  for (const CLI::Option* option : command.get_options()) {
    std::string own;
    for (const std::string& name : option->get_lnames()) {
      names += (names.empty() ? "--" : " --") + name;
      own += (own.empty() ? "" : "|") + command.get_name() + ":--" + name;
    }
    if (own.empty() || option->get_items_expected_max() == 0) continue;
    const std::string words = choices(*option);
    cases += "    " + own + ") " +
             (words.empty() ? "compopt -o default; return" : "words=\"" + words + "\"") + " ;;\n";
  }
}

std::string bash_completion(const CLI::App& app) {
  std::string commands, options, cases, names;
  add_options(app, names, cases);
  for (const CLI::App* command : app.get_subcommands({})) {
    commands += command->get_name() + " ";
    std::string own;
    add_options(*command, own, cases);
    options += "      " + command->get_name() + ") words=\"" + own + "\" ;;\n";
  }
  return "# bash completion of kincal; made by `kincal completion bash`\n"
         "_kincal() {\n"
         "  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} words=\n"
         "  COMPREPLY=()\n"
         "  if ((COMP_CWORD == 1)); then\n"
         "    COMPREPLY=($(compgen -W \"" +
         commands + names +
         "\" -- \"$word\"))\n"
         "    return\n"
         "  fi\n"
         "  case ${COMP_WORDS[1]}:$before in\n" +
         cases +
         "  esac\n"
         "  if [[ -z $words && $word == -* ]]; then\n"
         "    case ${COMP_WORDS[1]} in\n" +
         options +
         "    esac\n"
         "  fi\n"
         "  if [[ -n $words ]]; then\n"
         "    COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))\n"
         "  else\n"
         "    compopt -o default\n"
         "  fi\n"
         "}\n"
         "complete -F _kincal kincal\n";
}

}  // namespace

Command completion_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("completion", "Print a shell script that completes commands and options");
  command->add_option("SHELL", "the shell: bash")
      ->required()
      ->check(CLI::IsMember(std::vector<std::string>{"bash"}));
  command->footer(
      "Example for the current shell (the Debian package installs the script):\n"
      "  source <(kincal completion bash)");
  return {command, [&app] {
            std::cout << bash_completion(app);
            return 0;
          }};
}

}  // namespace kincal
