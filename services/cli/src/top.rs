//! The live screen: services, hops, rates, news.

use crate::beat::Beat;
use crate::report::Report;
use jink_shared_types::topics::TopicRow;
use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::{Cell, Paragraph, Row, Table, Widget};

/// A rate below this share of the declared one is marked.
const SLOW_SHARE: f64 = 0.8;
/// News that are kept.
const NEWS: usize = 8;

/// The rate of one topic.
#[derive(Clone, Debug)]
pub struct Rate {
    /// Name.
    pub name: String,
    /// Its row of the table.
    pub row: TopicRow,
    /// What came in the last second.
    pub beat: Beat,
}

/// Everything on the screen.
#[derive(Clone, Debug)]
pub struct Screen {
    /// Services and link.
    pub report: Report,
    /// Rates of topics.
    pub rates: Vec<Rate>,
    /// News, newest last.
    pub news: Vec<String>,
}

impl Screen {
    /// Adds a piece of news; the oldest goes.
    pub fn tell(&mut self, line: String) {
        if self.news.len() == NEWS {
            self.news.remove(0);
        }
        self.news.push(line);
    }

    /// Draws it into a terminal.
    pub fn draw(&self, frame: &mut Frame<'_>) {
        self.render(frame.area(), frame.buffer_mut());
    }

    /// As lines of text, `width` columns wide, for where there is no terminal.
    pub fn text(&self, width: u16) -> String {
        let mut buffer = Buffer::empty(Rect::new(0, 0, width, self.height()));
        self.render(buffer.area, &mut buffer);
        let lines = (0..buffer.area.height).map(|y| {
            let cells = (0..width).map(|x| buffer[(x, y)].symbol());
            cells.collect::<String>().trim_end().to_owned()
        });
        let mut text = lines.collect::<Vec<_>>().join("\n").trim_end().to_owned();
        text.push('\n');
        text
    }

    fn height(&self) -> u16 {
        let lines = 8 + self.report.services.len() + self.rates.len() + self.hops().height() + NEWS;
        u16::try_from(lines).unwrap_or(u16::MAX)
    }

    fn render(&self, area: Rect, buffer: &mut Buffer) {
        let hops = self.hops();
        let [head, services, link, rates, news] = Layout::vertical([
            Constraint::Length(2),
            Constraint::Length(self.report.services.len() as u16 + 2),
            Constraint::Length(hops.height() as u16 + 1),
            Constraint::Length(self.rates.len() as u16 + 2),
            Constraint::Min(0),
        ])
        .areas(area);
        self.head().render(head, buffer);
        self.services().render(services, buffer);
        Paragraph::new(hops).render(link, buffer);
        self.rates().render(rates, buffer);
        let lines: Vec<Line<'_>> = self.news.iter().map(|line| Line::from(line.as_str())).collect();
        Paragraph::new(lines).render(news, buffer);
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
                ", up {:.0} s, restarts {restarts}, supervisor {}   (q ends this)",
                self.report.uptime_s, self.report.supervisor_pid
            )),
        ])
    }

    fn services(&self) -> Table<'_> {
        let mut rows = self.report.table();
        let header = rows.remove(0);
        let widths: Vec<Constraint> = (0..header.len())
            .map(|column| {
                let widest = rows
                    .iter()
                    .map(|row| row[column].len())
                    .chain([header[column].len()]);
                Constraint::Length(widest.max().unwrap_or(0) as u16)
            })
            .collect();
        let body = rows
            .into_iter()
            .zip(&self.report.services)
            .map(|(cells, service)| {
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

    /// The way of a range to the wire, hop by hop.
    fn hops(&self) -> Text<'_> {
        match &self.report.link {
            Some(link) => Text::from(link.line()),
            None => Text::from("link: the gateway has said nothing yet"),
        }
    }
}

impl Screen {
    fn rates(&self) -> Table<'_> {
        let width = self.rates.iter().map(|rate| rate.name.len()).max().unwrap_or(0);
        let widths = [
            Constraint::Length(width.max(5) as u16),
            Constraint::Length(8),
            Constraint::Length(8),
            Constraint::Length(13),
            Constraint::Length(6),
            Constraint::Length(16),
        ];
        let header = [
            "topic",
            "Hz",
            "declared",
            "apart ms max",
            "lost",
            "age ms p50/p99",
        ];
        let body = self.rates.iter().map(Rate::line);
        Table::new(body.collect::<Vec<_>>(), widths)
            .column_spacing(2)
            .header(heading(header.map(Cell::from)))
    }
}

impl Rate {
    fn line(&self) -> Row<'_> {
        let rate_hz = self.beat.rate_hz();
        let slow = self.row.rate_hz > 0.0 && rate_hz.is_none_or(|hz| hz < SLOW_SHARE * self.row.rate_hz);
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1}"));
        let age = match (self.beat.age_s(0.5), self.beat.age_s(0.99)) {
            (Some(p50), Some(p99)) => format!("{:.1} / {:.1}", p50 * 1e3, p99 * 1e3),
            _ => "-".to_owned(),
        };
        let cells = [
            self.name.clone(),
            number(rate_hz),
            number(Some(self.row.rate_hz).filter(|hz| *hz > 0.0)),
            number(self.beat.longest_s().map(|s| s * 1e3)),
            self.beat.lost().to_string(),
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
    use super::{Rate, Screen};
    use crate::beat::Beat;
    use crate::report::Report;
    use jink_shared_types::health::SystemStatus;
    use jink_shared_types::topics::LOCAL_MAP;
    use jink_shared_types::{SampleHeader, Timestamp};

    #[test]
    fn the_screen_shows_health_rates_and_news() {
        let status = SystemStatus::default();
        let mut beat = Beat::default();
        for n in 0..11u64 {
            beat.take(&SampleHeader {
                sequence: n,
                publish: Timestamp::from_seconds(1.0 + n as f64 * 0.1),
                ..SampleHeader::default()
            });
        }
        let mut screen = Screen {
            report: Report::new("default", Timestamp::from_seconds(5.0), &status, None, Vec::new()),
            rates: vec![Rate {
                name: "map/local".to_owned(),
                row: LOCAL_MAP.row,
                beat,
            }],
            news: Vec::new(),
        };
        for n in 0..20 {
            screen.tell(format!("news {n}"));
        }
        let text = screen.text(120);
        for part in [
            "jink default: ",
            "map/local  10.0",
            "news 19",
            "service",
            "nothing yet",
        ] {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
        assert!(!text.contains("news 11\n"), "{text}");
    }
}
