//! The section `[notifications]`: who is told what, and how often it is tried.

use std::path::{Path, PathBuf};

use super::path;
use crate::{
    Complaint, Location,
    settings::{Setting, Table},
};

/// Who is told what happens on the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct NotificationsFile {
    /// From and until which minute of the day only faults are told; it may pass midnight.
    pub quiet: Option<[u32; 2]>,
    /// Time to the second attempt, s; it doubles with each further one.
    pub retry_after_s: f64,
    /// Attempts for one message at most.
    pub attempts: u32,
    /// Time limit of an attempt, s.
    pub attempt_s: f64,
    /// Certificates (PEM) of the authorities that `https` targets are checked against.
    pub certificates: PathBuf,
    /// Those who are told.
    pub targets: Vec<TargetFile>,
}

/// One who is told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TargetFile {
    /// Its name, which no other target has.
    pub name: String,
    /// How it is reached.
    pub via: Via,
    /// The kinds of what it is told.
    pub events: Vec<EventKind>,
    /// Attempts in a minute at most.
    pub per_minute: u32,
}

/// How a target is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Via {
    /// An HTTP POST of JSON.
    Webhook(Address),
    /// A topic of ntfy.
    Ntfy(Address),
    /// E-mail by the system's sendmail.
    Mail {
        /// Addresses of the recipients.
        to: Vec<String>,
        /// Address of the sender.
        from: String,
        /// The program.
        sendmail: PathBuf,
    },
}

/// A URL, and the secret that is sent with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Where it stands.
    pub url: Url,
    /// The file with the token for `Authorization: Bearer`.
    pub token_file: Option<PathBuf>,
}

/// Where a URL stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Url {
    /// In the service file.
    Text(String),
    /// In a file of its own, because it is a secret.
    File(PathBuf),
}

/// A kind of what happens on the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// A person is asked to do something.
    Prompt,
    /// A touch was refused.
    Refused,
    /// The rig is latched after a fault.
    Fault,
    /// A run has ended.
    End,
}

impl EventKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Prompt, Self::Refused, Self::Fault, Self::End];

    /// The word in files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Prompt => "prompt",
            Self::Refused => "refused",
            Self::Fault => "fault",
            Self::End => "end",
        }
    }
}

/// A target that cannot be told anything.
#[derive(Debug, thiserror::Error)]
enum TargetFault {
    #[error("there are two targets named \"{0}\"")]
    SameName(String),
    #[error("the target has no `url` and no `url_file`")]
    NoUrl,
    #[error("the target has `url` and `url_file`")]
    TwoUrls,
    #[error("url = \"{0}\" is not a URL of http or https with a host")]
    BadUrl(String),
    #[error("`{0}` is not a key of this kind of target")]
    OtherKind(&'static str),
    #[error("`{0}` is missing for e-mail")]
    NoMail(&'static str),
    #[error("\"{0}\" is not an e-mail address")]
    BadMail(String),
    #[error("\"{0}\" is not a time of the day")]
    BadTime(String),
    #[error("quiet is not two different times")]
    NoInterval,
}

impl Complaint for TargetFault {
    fn suggestion(&self) -> Option<String> {
        let suggestion = match self {
            Self::SameName(_) => "give it another name",
            Self::NoUrl => "give one of them",
            Self::TwoUrls => "remove one of them",
            Self::BadUrl(_) => "write it as \"https://chat.lab.example/hook\"",
            Self::OtherKind(_) => "remove it",
            Self::NoMail(_) => "give `to` and `from`",
            Self::BadMail(_) => "write it as \"ada@lab.example\"",
            Self::BadTime(_) => "write it as \"22:30\"",
            Self::NoInterval => "write it as [\"22:00\", \"06:30\"]",
        };
        Some(suggestion.to_owned())
    }
}

pub(super) fn notifications(table: &mut Table<'_>, folder: &Path) -> NotificationsFile {
    let quiet = table.text("quiet").list().optional();
    let retry_after_s = table.number("retry_after_s").range(0.01..=3600.0).or(5.0).value;
    let attempts = table.count("attempts").range(1..=100).or(20).value;
    let attempt_s = table.number("attempt_s").range(0.1..=120.0).or(10.0).value;
    let certificates = path(table, "certificates", folder);
    let target = |table: &mut Table<'_>| target(table, folder);
    let listed = table.section("targets", target).list().at_most(20).optional();
    let listed = listed.map_or_else(Vec::new, |listed| listed.value);
    let targets: Vec<_> = listed.into_iter().map(|target| target.value).collect();
    for (index, (name, _)) in targets.iter().enumerate() {
        let is_repeated = targets[..index].iter().any(|(other, _)| other.value == name.value);
        if is_repeated && name.sound().is_some() {
            table.refuse(name, &TargetFault::SameName(name.value.clone()));
        }
    }
    NotificationsFile {
        quiet: quiet.and_then(|quiet| minutes(table, &quiet)),
        retry_after_s,
        attempts,
        attempt_s,
        certificates: certificates
            .map_or_else(|| "/etc/ssl/certs/ca-certificates.crt".into(), |path| path.value),
        targets: targets.into_iter().map(|(_, target)| target).collect(),
    }
}

/// Two times of the day as minutes.
fn minutes(table: &Table<'_>, quiet: &Setting<Vec<Setting<String>>>) -> Option<[u32; 2]> {
    let minute = |text: &str| {
        let (hour, minute) = text.split_once(':')?;
        let is_short = hour.len() == 2 && minute.len() == 2;
        let (hour, minute): (u32, u32) = (hour.parse().ok()?, minute.parse().ok()?);
        (is_short && hour < 24 && minute < 60).then_some(hour * 60 + minute)
    };
    let mut found = Vec::new();
    for time in quiet.sound()? {
        match minute(time.sound()?) {
            Some(minute) => found.push(minute),
            None => table.refuse(time, &TargetFault::BadTime(time.value.clone())),
        }
    }
    match found[..] {
        [from, until] if from != until => Some([from, until]),
        _ if found.len() < quiet.value.len() => None,
        _ => {
            table.refuse(quiet, &TargetFault::NoInterval);
            None
        }
    }
}

/// What a kind of target needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Webhook,
    Ntfy,
    Mail,
}

fn target(table: &mut Table<'_>, folder: &Path) -> (Setting<String>, TargetFile) {
    let name = table.text("name").max_chars(60).required();
    let words = [("webhook", Kind::Webhook), ("ntfy", Kind::Ntfy), ("mail", Kind::Mail)];
    let kind = table.choice("kind", words).required();
    let url = table.text("url").max_chars(1000).optional();
    let url_file = path(table, "url_file", folder);
    let token_file = path(table, "token_file", folder);
    let to = table.text("to").list().at_most(50).optional();
    let from = table.text("from").optional();
    let sendmail = path(table, "sendmail", folder);
    let kinds = EventKind::ALL.map(|kind| (kind.name(), kind));
    let events = table.choice("events", kinds).list().optional();
    let per_minute = table.count("per_minute").range(1..=600).or(20).value;
    let is_mail = kind.value == Kind::Mail;
    if kind.sound().is_some() {
        let others = if is_mail {
            [place(url.as_ref()), place(url_file.as_ref()), place(token_file.as_ref())]
        } else {
            [place(to.as_ref()), place(from.as_ref()), place(sendmail.as_ref())]
        };
        for (key, location) in others.into_iter().flatten() {
            table.refuse(location, &TargetFault::OtherKind(key));
        }
    }
    let via = match kind.value {
        Kind::Mail => Via::Mail {
            to: recipients(table, to),
            from: sender(table, from),
            sendmail: sendmail.map_or_else(|| "/usr/sbin/sendmail".into(), |path| path.value),
        },
        kind => {
            let token_file = token_file.map(|path| path.value);
            let address = Address { url: place_of_url(table, url, url_file), token_file };
            if kind == Kind::Ntfy { Via::Ntfy(address) } else { Via::Webhook(address) }
        }
    };
    let all = || EventKind::ALL.to_vec();
    let listed = |events: Setting<Vec<Setting<EventKind>>>| {
        events.value.into_iter().map(|event| event.value).collect()
    };
    let events = events.map_or_else(all, listed);
    let target = TargetFile { name: name.value.clone(), via, events, per_minute };
    (name, target)
}

fn place<T>(setting: Option<&Setting<T>>) -> Option<(&'static str, Location)> {
    setting.map(|setting| (setting.key, setting.location))
}

fn place_of_url(
    table: &Table<'_>,
    url: Option<Setting<String>>,
    file: Option<Setting<PathBuf>>,
) -> Url {
    match (url, file) {
        (Some(url), None) => {
            if url.sound().is_some_and(|url| !is_url(url)) {
                table.refuse(&url, &TargetFault::BadUrl(url.value.clone()));
            }
            Url::Text(url.value)
        }
        (None, Some(file)) => Url::File(file.value),
        (Some(url), Some(_)) => {
            table.refuse(&url, &TargetFault::TwoUrls);
            Url::Text(url.value)
        }
        (None, None) => {
            if table.is_there() {
                table.refuse(table.location(), &TargetFault::NoUrl);
            }
            Url::Text(String::new())
        }
    }
}

/// Whether it begins as a URL of HTTP; the rest is looked at when it is used.
fn is_url(text: &str) -> bool {
    let rest = text.strip_prefix("http://").or_else(|| text.strip_prefix("https://"));
    rest.is_some_and(|rest| {
        rest.starts_with(|first: char| first.is_ascii_alphanumeric() || first == '[')
            && rest.chars().all(|letter| letter.is_ascii_graphic())
    })
}

/// The recipients. An address must not be read as an option or another header.
fn recipients(table: &Table<'_>, to: Option<Setting<Vec<Setting<String>>>>) -> Vec<String> {
    let Some(to) = to else {
        if table.is_there() {
            table.refuse(table.location(), &TargetFault::NoMail("to"));
        }
        return Vec::new();
    };
    for address in &to.value {
        address.sound().into_iter().filter(|text| !is_mail(text)).for_each(|text| {
            table.refuse(address, &TargetFault::BadMail(text.clone()));
        });
    }
    to.value.into_iter().map(|address| address.value).collect()
}

fn sender(table: &Table<'_>, from: Option<Setting<String>>) -> String {
    let Some(from) = from else {
        if table.is_there() {
            table.refuse(table.location(), &TargetFault::NoMail("from"));
        }
        return String::new();
    };
    if from.sound().is_some_and(|text| !is_mail(text)) {
        table.refuse(&from, &TargetFault::BadMail(from.value.clone()));
    }
    from.value
}

fn is_mail(text: &str) -> bool {
    let is_allowed = |letter: char| letter.is_ascii_alphanumeric() || ".-_+@".contains(letter);
    let parts = text.split_once('@');
    text.chars().all(is_allowed)
        && !text.starts_with('-')
        && parts
            .is_some_and(|(name, host)| !name.is_empty() && !host.is_empty() && !host.contains('@'))
}

#[cfg(test)]
mod tests {
    use super::{super::ServiceFile, *};

    fn read(text: &str) -> Result<NotificationsFile, String> {
        let read = ServiceFile::read(Path::new("/etc/rigd/service.toml"), text);
        let read = read.map_err(|faults| faults.to_string())?;
        Ok(read.notifications.expect("the section").value)
    }

    #[test]
    fn targets_have_their_defaults_and_their_files_begin_at_the_directory_of_the_file() {
        let text = "[notifications]\nquiet = [\"22:00\", \"06:30\"]\n\
            [[notifications.targets]]\nname = \"a\"\nkind = \"webhook\"\nurl_file = \"a.url\"\n\
            [[notifications.targets]]\nname = \"b\"\nkind = \"ntfy\"\nurl = \"https://[::1]:8/b\"\n\
            token_file = \"/b\"\nevents = [\"fault\"]\n\
            [[notifications.targets]]\nname = \"c\"\nkind = \"mail\"\nto = [\"x@y.example\"]\n\
            from = \"rigd+1@y\"\n";
        let read = read(text).unwrap();
        assert_eq!((read.quiet, read.attempts), (Some([1320, 390]), 20));
        assert_eq!((read.retry_after_s, read.attempt_s), (5.0, 10.0));
        assert_eq!(read.certificates, PathBuf::from("/etc/ssl/certs/ca-certificates.crt"));
        let [a, b, c] = &read.targets[..] else { panic!("{:?}", read.targets) };
        let url = Url::File("/etc/rigd/a.url".into());
        assert_eq!(a.via, Via::Webhook(Address { url, token_file: None }));
        assert_eq!((a.events.as_slice(), a.per_minute), (EventKind::ALL.as_slice(), 20));
        let url = Url::Text("https://[::1]:8/b".to_owned());
        assert_eq!(b.via, Via::Ntfy(Address { url, token_file: Some("/b".into()) }));
        assert_eq!(b.events, [EventKind::Fault]);
        let (to, from) = (vec!["x@y.example".to_owned()], "rigd+1@y".to_owned());
        assert_eq!(c.via, Via::Mail { to, from, sendmail: "/usr/sbin/sendmail".into() });
    }

    #[test]
    fn a_target_that_cannot_be_told_anything_is_refused() {
        let web = "kind = \"webhook\"\nurl = \"http://h/\"\n";
        for (keys, fault) in [
            ("kind = \"webhook\"", "the target has no `url` and no `url_file`; give one of them"),
            ("kind = \"webhook\"\nurl = \"h/x\"", "url = \"h/x\" is not a URL"),
            ("kind = \"ntfy\"\nurl = \"http:///x\"", "is not a URL of http or https with a host"),
            (&format!("{web}url_file = \"u\""), "the target has `url` and `url_file`"),
            (&format!("{web}from = \"a@b\""), "`from` is not a key of this kind of target"),
            (&format!("{web}events = [\"ends\"]"), "did you mean \"end\"?"),
            ("kind = \"mail\"\nfrom = \"a@b\"", "`to` is missing for e-mail"),
            ("kind = \"mail\"\nto = [\"a@b\"]", "`from` is missing for e-mail"),
            ("kind = \"mail\"\nto = [\"-oQ/tmp@b\"]\nfrom = \"a@b\"", "is not an e-mail address"),
            ("kind = \"mail\"\nto = [\"a@b\"]\nfrom = \"a b@c\"", "is not an e-mail address"),
            ("kind = \"pigeon\"", "is not one of \"webhook\", \"ntfy\", \"mail\""),
            (
                &format!("{web}[[notifications.targets]]\nname = \"a\"\n{web}"),
                "there are two targets named \"a\"",
            ),
        ] {
            let text = format!("[[notifications.targets]]\nname = \"a\"\n{keys}\n");
            let said = read(&text).unwrap_err();
            assert!(said.contains(fault), "{keys}: {said}");
        }
        for (quiet, fault) in [
            ("[\"22:00\"]", "quiet is not two different times"),
            ("[\"22:00\", \"22:00\"]", "quiet is not two different times"),
            ("[\"24:00\", \"06:00\"]", "\"24:00\" is not a time of the day"),
            ("[\"22:00\", \"6:00\"]", "\"6:00\" is not a time of the day"),
            ("\"22:00\"", "write [\"22:00\"]"),
        ] {
            let said = read(&format!("[notifications]\nquiet = {quiet}\n")).unwrap_err();
            assert!(said.contains(fault), "{quiet}: {said}");
        }
    }
}
