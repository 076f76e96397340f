//! Writes the manual pages and the shell completions of both programs from the definitions of their
//! command lines: `gshear-manual FOLDER DATE`.
//!
//! A program of its own, which only `make manual` builds: a hidden command would put the generators
//! into `gshear-mpi` and `gshear-reduce`, and a build script would run them in every build.

use std::fs;
use std::io;
use std::path::Path;

use clap::{Arg, Command, CommandFactory, ValueHint};
use clap_complete::Shell;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};
use gshear_mpi::{AUTO, CommandLine, NEW};
use gshear_reduce::Arguments;
use gshear_scene::templates::TEMPLATES;

/// Values that name a folder. Other paths may be files or folders, which shells offer for a file.
const FOLDERS: [&str; 2] = ["DIR", "NEW_FOLDER"];

fn main() -> io::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, date] = &arguments[..] else {
        eprintln!("usage: gshear-manual FOLDER DATE");
        std::process::exit(2);
    };
    let folder = Path::new(folder);
    let programs = [
        (CommandLine::command(), "gshear-reduce(1), mpirun(1)"),
        (Arguments::command(), "gshear-mpi(1)"),
    ];
    for (command, others) in programs {
        complete(command.clone(), folder)?;
        let pages = folder.join("man1");
        fs::create_dir_all(&pages)?;
        write_pages(command, others, date, &pages)?;
    }
    Ok(())
}

/// Writes the completions of bash, zsh and fish.
fn complete(command: Command, folder: &Path) -> io::Result<()> {
    let name = command.get_name().to_string();
    let is_simulation = command.find_subcommand(NEW).is_some();
    let command = if is_simulation {
        without_commands(&command)
    } else {
        command
    };
    let mut command = hinted(command.disable_help_subcommand(true));
    let shells = [
        (Shell::Bash, "bash", name.clone()),
        (Shell::Zsh, "zsh", format!("_{name}")),
        (Shell::Fish, "fish", format!("{name}.fish")),
    ];
    for (shell, place, file) in shells {
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut command, &name, &mut text);
        let mut text = String::from_utf8(text).expect("text");
        if shell == Shell::Bash {
            // The generator's two names of a command differ if that of the program has a dash
            // (clap_complete 4.6.11): no option of a command would be completed.
            let [label, wanted] = ["__subcmd__", "__"].map(|dash| name.replace('-', dash));
            text = text.replace(
                &format!("{label}__subcmd__"),
                &format!("{wanted}__subcmd__"),
            );
            text = files_without_dash(&text, command.has_subcommands());
        }
        if shell == Shell::Zsh {
            // Two colons hide the options before from what completes several paths, and with them
            // the values of an option behind a path.
            text = text.replace("'*::", "'*:");
        }
        if is_simulation {
            text = with_new(&with_auto(&text, shell), shell);
        }
        fs::create_dir_all(folder.join(place))?;
        fs::write(folder.join(place).join(file), text)?;
    }
    Ok(())
}

/// Says what each value is: without a hint, shells offer files for a number, too.
fn hinted(command: Command) -> Command {
    let of_argument = |argument: Arg| {
        let names = argument.get_value_names().unwrap_or_default();
        let of_folder = names.iter().any(|name| FOLDERS.contains(&name.as_str()));
        match argument.get_value_hint() {
            _ if of_folder => argument.value_hint(ValueHint::DirPath),
            ValueHint::Unknown => argument.value_hint(ValueHint::Other),
            ValueHint::AnyPath => argument.value_hint(ValueHint::FilePath),
            _ => argument,
        }
    };
    command.mut_args(of_argument).mut_subcommands(hinted)
}

/// The options of gshear-mpi without its commands: beside an argument that is a file, the
/// generators offer the commands in the second place, or no files.
fn without_commands(command: &Command) -> Command {
    let options = command.get_arguments().cloned();
    let without = Command::new("gshear-mpi").args(options);
    without.version(env!("CARGO_PKG_VERSION"))
}

/// Adds the command `new` with the names of its scenes.
fn with_new(text: &str, shell: Shell) -> String {
    let names = TEMPLATES.map(|template| template.name).join(" ");
    let (place, added) = match shell {
        Shell::Bash => (
            "    cmd=\"\"\n",
            format!(
                "    if [[ ${{COMP_CWORD}} -eq 2 && ${{COMP_WORDS[1]}} == {NEW} ]]; then\n\
                 \x20       COMPREPLY=($(compgen -W \"{names}\" -- \"${{COMP_WORDS[2]}}\"))\n\
                 \x20       return 0\n    fi\n\
                 \x20   if [[ ${{COMP_CWORD}} -eq 1 && -n ${{COMP_WORDS[1]}} && {NEW} == \"${{COMP_WORDS[1]}}\"* ]]; then\n\
                 \x20       COMPREPLY=($(compgen -W {NEW} -- \"${{COMP_WORDS[1]}}\") $(compgen -f -- \"${{COMP_WORDS[1]}}\"))\n\
                 \x20       return 0\n    fi\n"
            ),
        ),
        Shell::Zsh => (
            "    typeset -A opt_args\n",
            format!(
                "    if (( CURRENT == 3 )) && [[ $words[2] == {NEW} ]]; then\n\
                 \x20       compadd -- {names}\n        return\n    fi\n\
                 \x20   (( CURRENT == 2 )) && compadd -- {NEW}\n"
            ),
        ),
        _ => ("", {
            let is_new = format!("__fish_seen_subcommand_from {NEW}; and __fish_is_nth_token 2");
            format!(
                "complete -c gshear-mpi -n \"__fish_is_nth_token 1\" -a {NEW}\n\
                 complete -c gshear-mpi -n \"{is_new}\" -f -a \"{names}\"\n"
            )
        }),
    };
    let at = text.find(place).expect("the place") + place.len();
    let (head, tail) = text.split_at(at);
    head.to_string() + &added + tail
}

/// Adds the word `auto` to the paths that complete `--resume`: the generators offer words or paths.
fn with_auto(text: &str, shell: Shell) -> String {
    let (option, before, after) = match shell {
        Shell::Bash => (
            "--resume)\n",
            "COMPREPLY=(",
            format!("COMPREPLY=($(compgen -W {AUTO} -- \"${{cur}}\") "),
        ),
        Shell::Zsh => (
            "--resume=",
            ":_files",
            format!(":{{compadd -- {AUTO}; _files}}"),
        ),
        _ => ("-l resume ", "-l resume ", format!("-l resume -a {AUTO} ")),
    };
    let at = text.find(option).expect("the option");
    let (head, tail) = text.split_at(at);
    let changed = tail.replacen(before, &after, 1);
    assert_ne!(changed, tail, "{shell}: no {before}");
    head.to_string() + &changed
}

/// Lets bash complete files where a command takes some: the generator offers the options there,
/// too. Words are offered before a command is chosen, options after a dash.
fn files_without_dash(text: &str, has_commands: bool) -> String {
    let words = "COMPREPLY=( $(compgen -W \"${opts}\" -- \"${cur}\") )";
    let end = format!("esac\n            {words}\n");
    let kept = if has_commands {
        text.find(&end).map_or(0, |at| at + end.len())
    } else {
        0
    };
    let (head, tail) = text.split_at(kept);
    let mut lines = Vec::new();
    for line in tail.replace(&end, "esac\n").lines() {
        let condition = line
            .trim_start()
            .starts_with("if [[ ${cur} == -* || ${COMP_CWORD}");
        lines.push(if condition {
            "            if [[ ${cur} == -* ]] ; then".to_string()
        } else {
            line.to_string()
        });
    }
    head.to_string() + &lines.join("\n") + "\n"
}

/// Writes the pages of a program and of each of its commands.
fn write_pages(command: Command, others: &str, date: &str, folder: &Path) -> io::Result<()> {
    let name = command.get_name().to_string();
    let (mut command, codes) = without_codes(command.disable_help_subcommand(true));
    command.build();
    let page = |command: &Command, see_also: &str| {
        let page = Man::new(command.clone())
            .date(date)
            .source(concat!("gshear-mpi ", env!("CARGO_PKG_VERSION")))
            .manual("User Commands");
        let mut text = Vec::new();
        page.render_title(&mut text)?;
        page.render_name_section(&mut text)?;
        page.render_synopsis_section(&mut text)?;
        page.render_description_section(&mut text)?;
        page.render_options_section(&mut text)?;
        if command.has_subcommands() {
            page.render_subcommands_section(&mut text)?;
        }
        let mut end = Roff::new();
        end.control("SH", ["EXIT STATUS"]);
        for (code, meaning) in &codes {
            end.control("TP", [])
                .text([bold(code)])
                .text([roman(meaning)]);
        }
        end.control("SH", ["SEE ALSO"]).text([roman(see_also)]);
        end.to_writer(&mut text)?;
        // A blank line between two breaks is a warning of mandoc.
        let text = String::from_utf8(text).expect("text");
        let text = text.replace(".br\n\n.br\n", ".sp\n");
        fs::write(folder.join(page.get_filename()), text)
    };
    page(&command, others)?;
    for of_command in command.get_subcommands() {
        page(of_command, &format!("{name}(1)"))?;
    }
    Ok(())
}

/// A line of the exit codes: the code and what it means.
type Code = (String, String);

/// Makes a section of the paragraph of the exit codes, and one text of those before and after the
/// options.
fn without_codes(command: Command) -> (Command, Vec<Code>) {
    const CODES: &str = "Exit codes: ";
    let text = |text: Option<&clap::builder::StyledStr>| text.map(ToString::to_string);
    let about = text(command.get_long_about().or(command.get_about()));
    let texts = [about, text(command.get_after_help())];
    let texts: Vec<String> = texts.into_iter().flatten().collect();
    let paragraphs = texts.iter().flat_map(|text| text.split("\n\n"));
    let (codes, others): (Vec<&str>, Vec<&str>) = paragraphs.partition(|p| p.starts_with(CODES));
    let [codes] = codes[..] else {
        panic!("{}: no paragraph of the exit codes", command.get_name());
    };
    let codes = codes.replace('\n', " ");
    let codes = codes
        .trim_start_matches(CODES)
        .trim_end_matches('.')
        .split("; ");
    let mut codes: Vec<Code> = codes
        .map(|line| {
            let (code, meaning) = line.split_once(' ').expect("a code and its meaning");
            (code.to_string(), meaning.to_string())
        })
        .collect();
    codes.sort_by_key(|(code, _)| code.parse::<u8>().expect("a code"));
    (
        command
            .long_about(others.join("\n\n"))
            .after_help(None::<&str>),
        codes,
    )
}
