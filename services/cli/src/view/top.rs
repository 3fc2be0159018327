//! The live screen: services, hops, rates, events.

use crate::view::topic_statistics::TopicStatistics;
use jink_control::status::Report;
use jink_shared_types::topics::TopicRow;
use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::termion::event::Key;
use ratatui::termion::input::TermRead;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Cell, Paragraph, Row, Table, Widget};

/// A rate below this share of the declared one is marked.
const SLOW_SHARE: f64 = 0.8;
/// Events that are kept.
const EVENTS: usize = 8;
/// From this width on the services are shown in all columns.
const WIDE: u16 = 140;

/// The rate of one topic.
#[derive(Clone, Debug)]
pub struct Rate {
    /// Name.
    pub name: String,
    /// Its row of the table.
    pub row: TopicRow,
    /// What came in the last second.
    pub statistics: TopicStatistics,
}

/// What fills the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Showing {
    /// Services, and topics in the lines that are left.
    #[default]
    Both,
    /// Topics.
    Topics,
    /// Services.
    Services,
}

/// A key that was pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pressed {
    /// Enough was seen.
    End,
    /// So many lines of topics.
    Scroll(isize),
    /// Something else is to fill the screen.
    Next,
}

/// Topics that a page key scrolls.
const PAGE: isize = 8;

impl Pressed {
    /// The keys in what was typed.
    pub fn of(typed: &[u8]) -> Vec<Self> {
        let keys = typed.keys().filter_map(Result::ok);
        keys.filter_map(|key| {
            Some(match key {
                Key::Char('q') | Key::Ctrl('c') | Key::Esc => Self::End,
                Key::Up | Key::Char('k') => Self::Scroll(-1),
                Key::Down | Key::Char('j') => Self::Scroll(1),
                Key::PageUp => Self::Scroll(-PAGE),
                Key::PageDown | Key::Char(' ') => Self::Scroll(PAGE),
                Key::Home => Self::Scroll(isize::MIN),
                Key::End => Self::Scroll(isize::MAX),
                Key::Char('\t') => Self::Next,
                _ => return None,
            })
        })
        .collect()
    }
}

/// Everything on the screen.
#[derive(Clone, Debug)]
pub struct Screen {
    /// Services and link.
    pub report: Report,
    /// Rates of topics.
    pub rates: Vec<Rate>,
    /// Events, newest last.
    pub events: Vec<String>,
    /// How many topics are scrolled away above the first that is shown.
    pub scrolled: usize,
    /// What fills it.
    pub showing: Showing,
}

/// Where things are on a screen. What does not fit is left out in this order: all events but the last, topics (they can be
/// scrolled), the lines of the link.
struct Areas {
    head: Rect,
    services: Rect,
    link: Rect,
    rates: Rect,
    events: Rect,
    foot: Rect,
}

impl Areas {
    fn of(screen: &Screen, area: Rect) -> Self {
        let lines = |count: usize| u16::try_from(count).unwrap_or(u16::MAX);
        let unless = |other: Showing, count: usize| if screen.showing == other { 0 } else { lines(count) };
        let services = unless(Showing::Topics, screen.report.services.len() + 1);
        let link = unless(Showing::Topics, screen.hops(area.width).len());
        let rates = unless(Showing::Services, screen.rates.len() + 1);
        let events = lines(screen.events.len()).max(1);
        let spared = area.height.saturating_sub(2 + services + link);
        let events = events.min(spared.saturating_sub(rates).max(1));
        let [head, services, link, rates, events, foot] = Layout::vertical([
            Constraint::Length(1),
            Constraint::Length(services),
            Constraint::Length(link.min(area.height.saturating_sub(services + 6))),
            Constraint::Length(rates.min(spared.saturating_sub(events))),
            Constraint::Min(0),
            Constraint::Length(1),
        ])
        .areas(area);
        Self {
            head,
            services,
            link,
            rates,
            events,
            foot,
        }
    }

    /// Topics that fit below their heading.
    fn topics(&self) -> usize {
        usize::from(self.rates.height.saturating_sub(1))
    }
}

impl Screen {
    /// With the services of `report`, and nothing else yet.
    pub fn of(report: Report) -> Self {
        Self {
            report,
            rates: Vec::new(),
            events: Vec::new(),
            scrolled: 0,
            showing: Showing::default(),
        }
    }

    /// Does what the key asks for.
    pub fn press(&mut self, key: Pressed) {
        match key {
            Pressed::End => {}
            Pressed::Scroll(lines) => self.scroll(lines),
            Pressed::Next => {
                self.showing = match self.showing {
                    Showing::Both => Showing::Topics,
                    Showing::Topics => Showing::Services,
                    Showing::Services => Showing::Both,
                };
            }
        }
    }

    /// Adds an event; the oldest goes.
    pub fn push_event(&mut self, line: String) {
        if self.events.len() == EVENTS {
            self.events.remove(0);
        }
        self.events.push(line);
    }

    /// Scrolls the topics by so many lines, as far as there are any.
    pub fn scroll(&mut self, lines: isize) {
        self.scrolled = self
            .scrolled
            .saturating_add_signed(lines)
            .min(self.rates.len().saturating_sub(1));
    }

    /// Draws it into a terminal.
    pub fn draw(&mut self, frame: &mut Frame<'_>) {
        let fit = Areas::of(self, frame.area()).topics();
        // The last page is a full one.
        self.scrolled = self.scrolled.min(self.rates.len().saturating_sub(fit));
        self.render(frame.area(), frame.buffer_mut());
    }

    /// As lines of text, `width` columns wide, for where there is no terminal.
    pub fn text(&self, width: u16) -> String {
        self.text_of(width, self.height(width))
    }

    fn text_of(&self, width: u16, height: u16) -> String {
        let mut buffer = Buffer::empty(Rect::new(0, 0, width, height));
        self.render(buffer.area, &mut buffer);
        let lines = (0..buffer.area.height).map(|y| {
            let cells = (0..width).map(|x| buffer[(x, y)].symbol());
            cells.collect::<String>().trim_end().to_owned()
        });
        let mut text = lines.collect::<Vec<_>>().join("\n").trim_end().to_owned();
        text.push('\n');
        text
    }

    fn height(&self, width: u16) -> u16 {
        let lines = 4 + self.report.services.len() + self.rates.len() + self.hops(width).len() + EVENTS;
        u16::try_from(lines).unwrap_or(u16::MAX)
    }

    fn render(&self, area: Rect, buffer: &mut Buffer) {
        let areas = Areas::of(self, area);
        self.head().render(areas.head, buffer);
        match areas.services.width >= WIDE {
            true => services(&self.report, self.report.table()).render(areas.services, buffer),
            false => services(&self.report, self.report.narrow_table()).render(areas.services, buffer),
        }
        let hops: Vec<Line<'_>> = self.hops(area.width).into_iter().map(Line::from).collect();
        Paragraph::new(hops).render(areas.link, buffer);
        self.rates().render(areas.rates, buffer);
        let newest = self.events.len().saturating_sub(usize::from(areas.events.height));
        let lines: Vec<Line<'_>> = self.events[newest..]
            .iter()
            .map(|line| Line::from(line.as_str()))
            .collect();
        Paragraph::new(lines).render(areas.events, buffer);
        self.foot(areas.topics()).render(areas.foot, buffer);
    }

    fn head(&self) -> Line<'_> {
        let color = match self.report.health.as_str() {
            "healthy" => Color::Green,
            "failed" => Color::Red,
            _ => Color::Yellow,
        };
        let restarts: u32 = self.report.services.iter().map(|service| service.restarts).sum();
        Line::from(vec![
            Span::raw(format!("jink {}: ", self.report.instance)),
            Span::styled(self.report.health.clone(), Style::new().fg(color).bold()),
            Span::raw(format!(
                ", up {:.0} s, restarts {restarts}, supervisor {}",
                self.report.uptime_s, self.report.supervisor_pid
            )),
        ])
    }

    fn foot(&self, fit: usize) -> Line<'_> {
        let (first, all) = (self.scrolled + 1, self.rates.len());
        let text = match all > fit && fit > 0 {
            true => format!(
                "q ends this   Tab: topics alone   up, down, PgUp, PgDn: topics {first} to {} of {all}",
                (self.scrolled + fit).min(all)
            ),
            false => "q ends this   Tab: topics, services, both".to_owned(),
        };
        Line::styled(text, Style::new().add_modifier(Modifier::DIM))
    }

    /// The way of a range to the wire, hop by hop, in lines of `width`.
    fn hops(&self, width: u16) -> Vec<String> {
        let text = match &self.report.link {
            Some(link) => link.line(),
            None => "link: the gateway has said nothing yet".to_owned(),
        };
        text.lines()
            .flat_map(|line| wrapped(line, usize::from(width)))
            .collect()
    }

    fn rates(&self) -> Table<'_> {
        let width = self.rates.iter().map(|rate| rate.name.len()).max().unwrap_or(0);
        let widths = [
            Constraint::Length(width.max(5) as u16),
            Constraint::Length(7),
            Constraint::Length(8),
            Constraint::Length(12),
            Constraint::Length(5),
            Constraint::Length(14),
        ];
        let header = [
            "topic",
            "Hz",
            "least Hz",
            "apart ms max",
            "lost",
            "age ms p50/p99",
        ];
        let body = self.rates.iter().skip(self.scrolled).map(Rate::line);
        Table::new(body.collect::<Vec<_>>(), widths)
            .column_spacing(2)
            .header(heading(header.map(Cell::from)))
    }
}

/// `line` in pieces of at most `width` characters, cut at spaces where there are any; all but the first are set in as the line is.
fn wrapped(line: &str, width: usize) -> Vec<String> {
    let indent: String = line.chars().take_while(|letter| *letter == ' ').collect();
    let mut lines = vec![String::new()];
    for word in line.split_inclusive(' ') {
        let last = lines.last().map_or(0, |last| last.chars().count());
        if last + word.trim_end().chars().count() > width && last > indent.len() {
            lines.push(format!("{indent}      "));
        }
        if let Some(last) = lines.last_mut() {
            last.push_str(word);
        }
    }
    lines
}

/// The table of services with the columns of `rows`, of which the first is the header.
fn services<const N: usize>(report: &Report, mut rows: Vec<[String; N]>) -> Table<'static> {
    let header = rows.remove(0);
    let widths: Vec<Constraint> = (0..N)
        .map(|column| {
            let widest = rows
                .iter()
                .map(|row| row[column].len())
                .chain([header[column].len()]);
            Constraint::Length(widest.max().unwrap_or(0) as u16)
        })
        .collect();
    let body = rows.into_iter().zip(&report.services).map(|(cells, service)| {
        let style = match service.state.as_str() {
            "active" => Style::new(),
            "degraded" | "starting" | "standby" => Style::new().fg(Color::Yellow),
            _ => Style::new().fg(Color::Red),
        };
        Row::new(cells.map(Cell::from)).style(style)
    });
    Table::new(body.collect::<Vec<_>>(), widths)
        .column_spacing(2)
        .header(heading(header.map(Cell::from)))
}

impl Rate {
    fn line(&self) -> Row<'_> {
        let rate_hz = self.statistics.rate_hz();
        let slow = self.row.rate_hz > 0.0 && rate_hz.is_none_or(|hz| hz < SLOW_SHARE * self.row.rate_hz);
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1}"));
        let age = match (self.statistics.age_s(0.5), self.statistics.age_s(0.99)) {
            (Some(p50), Some(p99)) => format!("{:.1} / {:.1}", p50 * 1e3, p99 * 1e3),
            _ => "-".to_owned(),
        };
        let cells = [
            self.name.clone(),
            number(rate_hz),
            number(Some(self.row.rate_hz).filter(|hz| *hz > 0.0)),
            number(self.statistics.longest_s().map(|s| s * 1e3)),
            self.statistics.lost().to_string(),
            age,
        ];
        let style = if slow {
            Style::new().fg(Color::Yellow)
        } else {
            Style::new()
        };
        Row::new(cells.map(Cell::from)).style(style)
    }
}

fn heading<const N: usize>(cells: [Cell<'_>; N]) -> Row<'_> {
    Row::new(cells).style(Style::new().add_modifier(Modifier::BOLD))
}

#[cfg(test)]
mod tests {
    use super::{Pressed, Rate, Screen, wrapped};
    use crate::view::topic_statistics::TopicStatistics;
    use jink_control::status::Report;
    use jink_shared_types::coded::{Coded, Flag};
    use jink_shared_types::health::{Name, ServiceState, SystemStatus};
    use jink_shared_types::topics::LOCAL_MAP;
    use jink_shared_types::{SampleHeader, Timestamp};

    #[test]
    fn the_screen_shows_health_rates_and_news() {
        let status = SystemStatus::default();
        let mut statistics = TopicStatistics::default();
        for n in 0..11u64 {
            statistics.take(&SampleHeader {
                sequence: n,
                publish: Timestamp::from_seconds(1.0 + n as f64 * 0.1),
                ..SampleHeader::default()
            });
        }
        let report = Report::new("default", Timestamp::from_seconds(5.0), &status, None, Vec::new());
        let mut screen = Screen {
            rates: vec![Rate {
                name: "map/local".to_owned(),
                row: LOCAL_MAP.row,
                statistics,
            }],
            ..Screen::of(report)
        };
        for n in 0..20 {
            screen.push_event(format!("event {n}"));
        }
        let text = screen.text(120);
        for part in [
            "jink default: ",
            "map/local  10.0",
            "event 19",
            "service",
            "nothing yet",
        ] {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
        assert!(!text.contains("event 11\n"), "{text}");
    }

    /// Eight services with long names and process ids, thirty topics, events.
    fn crowded() -> Screen {
        let mut status = SystemStatus {
            len: 8,
            ..SystemStatus::default()
        };
        for (n, process) in status.processes.iter_mut().take(8).enumerate() {
            process.heartbeat.name = Name::new(&format!("mavlink_gateway_{n}"));
            process.pid = 1_234_560 + n as u32;
            process.state = Coded::new(ServiceState::Degraded);
            process.essential = Flag::YES;
        }
        let rates = (0..30).map(|n| Rate {
            name: format!("range/scan/number_{n}"),
            row: LOCAL_MAP.row,
            statistics: TopicStatistics::default(),
        });
        let report = Report::new("default", Timestamp::from_seconds(5.0), &status, None, Vec::new());
        Screen {
            rates: rates.collect(),
            events: vec!["planner: restarted".to_owned()],
            ..Screen::of(report)
        }
    }

    #[test]
    fn every_key_that_was_typed_at_once_counts() {
        // Down, down, page down, up.
        let keys = Pressed::of(b"\x1b[B\x1b[B\x1b[6~\x1b[A");
        let mut screen = crowded();
        keys.into_iter().for_each(|key| screen.press(key));
        assert_eq!(screen.scrolled, 9);
        assert_eq!(Pressed::of(b"jq"), [Pressed::Scroll(1), Pressed::End]);
    }

    #[test]
    fn topics_alone_and_services_alone_fill_a_small_screen() {
        let mut screen = crowded();
        let shown = |screen: &Screen| {
            let text = screen.text_of(80, 24);
            (
                text.matches("range/scan/").count(),
                text.matches("mavlink_gateway_").count(),
            )
        };
        let (few, all) = shown(&screen);
        assert!(few < 12 && all == 8);
        screen.press(Pressed::Next);
        let (topics, services) = shown(&screen);
        assert!(topics >= 20 && services == 0, "{topics} {services}");
        screen.press(Pressed::Next);
        assert_eq!(shown(&screen), (0, 8));
        screen.press(Pressed::Next);
        assert_eq!(shown(&screen), (few, all));
    }

    #[test]
    fn eighty_columns_and_twenty_four_lines_show_every_service_whole() {
        let mut screen = crowded();
        let text = screen.text_of(80, 24);
        for n in 0..8 {
            let row = format!("mavlink_gateway_{n}  degraded !  {}", 1_234_560 + n);
            assert!(text.contains(&row), "{row:?} is not in\n{text}");
        }
        for part in [
            "cpu %",
            "range/scan/number_0",
            "planner: restarted",
            "of 30",
            "link: ",
        ] {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
        assert!(text.lines().count() <= 24 && text.lines().all(|line| line.chars().count() <= 80));
        assert!(!text.contains("number_29"));
        screen.scroll(isize::MAX);
        assert!(
            screen.text_of(80, 24).contains("number_29"),
            "{}",
            screen.text_of(80, 24)
        );
        screen.scroll(isize::MIN);
        assert_eq!(screen.text_of(80, 24), text);
    }

    #[test]
    fn long_lines_are_continued_and_nothing_of_them_is_lost() {
        let line = "      3 setpoints, largest gap 51 ms; capture to wire 12.0 / 13.0 / 14.0 ms p50/p99/max";
        let lines = wrapped(line, 40);
        assert!(
            lines.len() > 1 && lines.iter().all(|line| line.trim_end().len() <= 40),
            "{lines:?}"
        );
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(words(&lines.concat()), words(line));
        assert_eq!(wrapped("short", 40), ["short"]);
    }
}
