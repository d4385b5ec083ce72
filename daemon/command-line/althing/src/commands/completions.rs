//! `althing completions`: prints scripts that let a shell complete the command line, and the words of
//! goals, for which these scripts ask.

use std::process::ExitCode;

use clap::CommandFactory as _;
use clap_complete::{Shell, generate};
use phrases::KnownNames;
use terminal::{exit, output};

use crate::asking::known_names;
use crate::cli::{Cli, CompletionsArgs, ReachArgs, ShellArg};
use crate::commands::client::{self, ClientTarget};
use crate::speech;

/// Lets bash complete the words of a goal within quotes.
const BASH_WORDS: &str = r#"
_althing_words() {
    local current="${COMP_WORDS[COMP_CWORD]}"
    if [[ "${COMP_WORDS[1]}" == goal && "$current" == [\"\']* ]]; then
        local IFS=$'\n'
        COMPREPLY=($(althing completions --words "${current:1}" 2>/dev/null))
        # A single word would end the quotes; a second one lets the sentence go on.
        [[ ${#COMPREPLY[@]} == 1 ]] && COMPREPLY=("${COMPREPLY[0]} " "${COMPREPLY[0]} …")
        return 0
    fi
    _althing "$@"
}
complete -F _althing_words -o bashdefault -o default althing
"#;

/// Lets fish do the same.
const FISH_WORDS: &str = r#"
complete -c althing -f -n "__fish_seen_subcommand_from goal" -a "(althing completions --words (string trim -l -c '\"' -- (commandline -ct | string trim -l -c \"'\")) 2>/dev/null)"
"#;

/// Prints the completion script for the shell that the user names, or the words that scripts ask for.
pub(super) fn run(args: &CompletionsArgs) -> ExitCode {
    if let Some(text) = &args.words {
        return words(text);
    }
    let (shell, more) = match args.shell {
        Some(ShellArg::Zsh) => (Shell::Zsh, ""),
        Some(ShellArg::Fish) => (Shell::Fish, FISH_WORDS),
        Some(ShellArg::Bash) | None => (Shell::Bash, BASH_WORDS),
    };
    let mut script = Vec::new();
    generate(shell, &mut Cli::command(), "althing", &mut script);
    output::print_raw(&(String::from_utf8_lossy(&script) + more), exit::DONE)
}

/// Prints the texts that `text` can become, with the names of the ecosystem that runs here or, if
/// none does, with those of the ecosystem file.
fn words(text: &str) -> ExitCode {
    let reach = ReachArgs::default();
    if ClientTarget::find(&reach).is_ok() {
        return client::with_link(&reach, false, async |link| {
            let names = known_names::known_names(&link.view).await;
            let code = print_words(text, &names);
            (link, code)
        });
    }
    let ecosystem = ClientTarget::choose(&reach).ok().and_then(|(_, ecosystem)| ecosystem);
    let names = ecosystem.map(|file| KnownNames::of(&file.domain, &file.problem));
    print_words(text, &names.unwrap_or_default())
}

fn print_words(text: &str, names: &KnownNames) -> ExitCode {
    let (start, words) = speech::complete(text, names);
    let before = text.get(..start).unwrap_or_default();
    let plain = words.iter().filter(|word| terminal::visible::is_plain(word));
    let lines: String = plain.map(|word| format!("{before}{word}\n")).collect();
    output::print_raw(&lines, exit::DONE)
}
