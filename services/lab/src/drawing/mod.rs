//! Drawings as SVG, for every picture and every plot. Only what SVG 1.1 has is written, so that every program that draws
//! SVG draws the same: a newer standard's colours are drawn black by many. Places are in pixels from the upper left corner,
//! x to the right and y downwards; what lies at a place that is not finite is left out.
//!
//! | | in | out |
//! |---|---|---|
//! | [`Group`] | shapes and words, one after the other: later ones cover earlier ones | part of a picture |
//! | [`Frame`] | values | places in pixels, curves, bars, axes with round numbers |
//! | [`Document`] | size, background, a group | the SVG |

mod frame;

pub use frame::{Area, Frame, legend, step};

use std::fmt;
use svg::Node;
use svg::node::element::Element;

/// A place: to the right, downwards (pixels).
pub type Place = (f64, f64);

/// A colour; it is written as six hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(u32);

impl Colour {
    /// Of the Okabe-Ito palette, which differs for those who do not see red and green apart, too.
    pub const BLUE: Self = Self(0x0072b2);
    /// Of the same palette.
    pub const VERMILION: Self = Self(0xd55e00);
    /// For what stands behind the two.
    pub const GREY: Self = Self(0x777777);
    /// White.
    pub const WHITE: Self = Self(0xffffff);
    /// Black.
    pub const BLACK: Self = Self(0);

    /// For several curves, one after the other: of the same palette.
    pub const SEVERAL: [Self; 6] = [
        Self::BLUE,
        Self::VERMILION,
        Self::hex(0x009e73),
        Self::hex(0xcc79a7),
        Self::hex(0xe69f00),
        Self::hex(0x56b4e9),
    ];

    /// As it stands in style sheets: `0xrrggbb`.
    pub const fn hex(rgb: u32) -> Self {
        Self(rgb & 0xffffff)
    }

    /// Of its parts, 0 to 255 each.
    pub const fn rgb([red, green, blue]: [u8; 3]) -> Self {
        Self((red as u32) << 16 | (green as u32) << 8 | blue as u32)
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{:06x}", self.0)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fill {
    Inherited,
    Nothing,
    Colour(Colour),
}

/// How shapes are filled and outlined. What is not said is that of the group around; without any, filled black and not
/// outlined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    fill: Fill,
    opacity: Option<f64>,
    stroke: Option<Colour>,
    width_px: Option<f64>,
    dashes_px: Option<[f64; 2]>,
    has_round_ends: bool,
}

impl Style {
    /// As the group around.
    pub const INHERITED: Self = Self {
        fill: Fill::Inherited,
        opacity: None,
        stroke: None,
        width_px: None,
        dashes_px: None,
        has_round_ends: false,
    };

    /// A line: nothing is filled.
    pub const fn line(colour: Colour, width_px: f64) -> Self {
        Self::hollow().stroke(colour).width(width_px)
    }

    /// Nothing is filled.
    pub const fn hollow() -> Self {
        Self {
            fill: Fill::Nothing,
            ..Self::INHERITED
        }
    }

    /// Filled.
    pub const fn filled(colour: Colour) -> Self {
        Self {
            fill: Fill::Colour(colour),
            ..Self::INHERITED
        }
    }

    /// What is filled lets through what is below: 0 all of it, 1 nothing.
    pub const fn opacity(mut self, share: f64) -> Self {
        self.opacity = Some(share);
        self
    }

    /// The outline's colour.
    pub const fn stroke(mut self, colour: Colour) -> Self {
        self.stroke = Some(colour);
        self
    }

    /// The outline's width (pixels).
    pub const fn width(mut self, width_px: f64) -> Self {
        self.width_px = Some(width_px);
        self
    }

    /// The outline is dashed: so much of it is drawn, so much left out (pixels).
    pub const fn dashed(mut self, dashes_px: [f64; 2]) -> Self {
        self.dashes_px = Some(dashes_px);
        self
    }

    /// Lines end in half a circle.
    pub const fn round_ends(mut self) -> Self {
        self.has_round_ends = true;
        self
    }

    fn dress(&self, element: &mut Element) {
        match self.fill {
            Fill::Inherited => {}
            Fill::Nothing => element.assign("fill", "none"),
            Fill::Colour(colour) => element.assign("fill", colour.to_string()),
        }
        if let Some(share) = self.opacity {
            element.assign("fill-opacity", share);
        }
        if let Some(colour) = self.stroke {
            element.assign("stroke", colour.to_string());
        }
        if let Some(width_px) = self.width_px {
            element.assign("stroke-width", width_px);
        }
        if let Some([drawn_px, left_out_px]) = self.dashes_px {
            element.assign("stroke-dasharray", (drawn_px, left_out_px));
        }
        if self.has_round_ends {
            element.assign("stroke-linecap", "round");
        }
    }
}

/// Which part of a line of text lies at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Anchor {
    Start,
    Middle,
    End,
}

/// How words are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Letters {
    anchor: Anchor,
    size_px: Option<f64>,
    is_bold: bool,
}

impl Letters {
    /// The words begin at their place.
    pub const START: Self = Self {
        anchor: Anchor::Start,
        size_px: None,
        is_bold: false,
    };
    /// Their middle is there.
    pub const MIDDLE: Self = Self {
        anchor: Anchor::Middle,
        ..Self::START
    };
    /// They end there.
    pub const END: Self = Self {
        anchor: Anchor::End,
        ..Self::START
    };

    /// Larger or smaller than the document's (pixels).
    pub const fn size(mut self, size_px: f64) -> Self {
        self.size_px = Some(size_px);
        self
    }

    /// Bold.
    pub const fn bold(mut self) -> Self {
        self.is_bold = true;
        self
    }

    fn dress(&self, element: &mut Element) {
        match self.anchor {
            // What it is anyway.
            Anchor::Start => {}
            Anchor::Middle => element.assign("text-anchor", "middle"),
            Anchor::End => element.assign("text-anchor", "end"),
        }
        if let Some(size_px) = self.size_px {
            element.assign("font-size", size_px);
        }
        if self.is_bold {
            element.assign("font-weight", "bold");
        }
    }
}

/// Shapes and words, one after the other: later ones cover earlier ones.
#[derive(Clone, Debug)]
pub struct Group {
    element: Element,
}

impl Default for Group {
    fn default() -> Self {
        Self::new(Style::INHERITED)
    }
}

impl Group {
    /// An empty one; `style` is that of everything in it that does not say otherwise.
    pub fn new(style: Style) -> Self {
        let mut element = Element::new("g");
        style.dress(&mut element);
        Self { element }
    }

    /// A group within it.
    pub fn add(&mut self, group: Self) {
        self.element.append(group.element);
    }

    /// A group within it, of which only what lies in `area` is seen.
    pub fn add_clipped(&mut self, area: Area, group: Self) {
        let Some(shape) = rect(area) else { return };
        // Whoever has the same name, in this picture or in another one on the same page, has the same area.
        let name = format!(
            "clip_{:.0}_{:.0}_{:.0}_{:.0}",
            area.left, area.top, area.width, area.height
        );
        let mut clip = Element::new("clipPath");
        clip.assign("id", name.as_str());
        clip.append(shape);
        self.element.append(clip);
        let mut element = group.element;
        element.assign("clip-path", format!("url(#{name})"));
        self.element.append(element);
    }

    /// A circle.
    pub fn circle(&mut self, (x, y): Place, radius_px: f64, style: Style) {
        self.shape(shape("circle", &[("cx", x), ("cy", y), ("r", radius_px)]), style);
    }

    /// An upright rectangle.
    pub fn rect(&mut self, area: Area, style: Style) {
        self.shape(rect(area), style);
    }

    /// A rectangle around `centre`, turned clockwise by `turn_deg` (deg) from lying along x.
    pub fn turned_rect(
        &mut self,
        centre: Place,
        [length_px, width_px]: [f64; 2],
        turn_deg: f64,
        style: Style,
    ) {
        let (x, y) = centre;
        let turned = rect(Area {
            left: x - 0.5 * length_px,
            top: y - 0.5 * width_px,
            width: length_px,
            height: width_px,
        });
        let turned = turned.filter(|_| turn_deg.is_finite()).map(|mut element| {
            element.assign("transform", format!("rotate({turn_deg:.2} {x:.1} {y:.1})"));
            element
        });
        self.shape(turned, style);
    }

    /// A straight line.
    pub fn line(&mut self, (x1, y1): Place, (x2, y2): Place, style: Style) {
        let ends = [("x1", x1), ("y1", y1), ("x2", x2), ("y2", y2)];
        self.shape(shape("line", &ends), style);
    }

    /// Straight lines from place to place; those that are not finite are passed over.
    pub fn polyline(&mut self, places: impl IntoIterator<Item = Place>, style: Style) {
        let places: Vec<String> = places
            .into_iter()
            .filter(|(x, y)| x.is_finite() && y.is_finite())
            .map(|(x, y)| format!("{x:.1},{y:.1}"))
            .collect();
        if places.is_empty() {
            return;
        }
        let mut element = Element::new("polyline");
        element.assign("points", places.join(" "));
        self.shape(Some(element), style);
    }

    /// A line of text; its lower edge, without what hangs below, is at the height of its place.
    pub fn text(&mut self, place: Place, letters: Letters, words: &str) {
        self.words(place, letters, |text| text.append(svg::node::Text::new(words)));
    }

    /// A line of text that begins with something bold.
    pub fn text_with_lead(&mut self, place: Place, letters: Letters, lead: &str, words: &str) {
        self.words(place, letters, |text| {
            let mut bold = Element::new("tspan");
            Letters::START.bold().dress(&mut bold);
            bold.append(svg::node::Text::new(lead));
            text.append(bold);
            text.append(svg::node::Text::new(format!(" {words}")));
        });
    }

    fn words(&mut self, (x, y): Place, letters: Letters, fill: impl FnOnce(&mut Element)) {
        // Not the library's own element for text: it puts the words on lines of their own.
        if let Some(mut text) = shape("text", &[("x", x), ("y", y)]) {
            letters.dress(&mut text);
            fill(&mut text);
            self.element.append(text);
        }
    }

    fn shape(&mut self, element: Option<Element>, style: Style) {
        if let Some(mut element) = element {
            style.dress(&mut element);
            self.element.append(element);
        }
    }
}

/// An element with these numbers (pixels), if all of them are finite.
fn shape(name: &str, numbers: &[(&str, f64)]) -> Option<Element> {
    let mut element = Element::new(name);
    for (name, value_px) in numbers {
        if !value_px.is_finite() {
            return None;
        }
        element.assign(*name, format!("{value_px:.1}"));
    }
    Some(element)
}

fn rect(area: Area) -> Option<Element> {
    let numbers = [
        ("x", area.left),
        ("y", area.top),
        ("width", area.width),
        ("height", area.height),
    ];
    shape("rect", &numbers)
}

/// A whole picture.
#[derive(Clone, Debug)]
pub struct Document {
    /// Width (pixels).
    pub width_px: f64,
    /// Height (pixels).
    pub height_px: f64,
    /// Colour behind everything.
    pub background: Colour,
    /// Size of letters that do not say otherwise (pixels).
    pub letters_px: f64,
    /// What is drawn.
    pub content: Group,
}

impl Document {
    /// As a file.
    pub fn into_svg(self) -> String {
        let [width, height] = [self.width_px, self.height_px].map(f64::round);
        let mut background = Element::new("rect");
        background.assign("width", width);
        background.assign("height", height);
        background.assign("fill", self.background.to_string());
        let mut content = self.content.element;
        let mut svg = Element::from(svg::Document::new());
        svg.assign("viewBox", (0, 0, width, height));
        svg.assign("width", width);
        svg.assign("height", height);
        svg.assign("font-family", "sans-serif");
        svg.assign("font-size", self.letters_px);
        svg.append(background);
        svg.get_children_mut().append(content.get_children_mut());
        format!("{svg}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::{Area, Colour, Document, Frame, Group, Letters, Style};

    fn drawn(content: Group) -> String {
        let document = Document {
            width_px: 100.0,
            height_px: 50.0,
            background: Colour::WHITE,
            letters_px: 12.0,
            content,
        };
        document.into_svg()
    }

    #[test]
    fn words_are_escaped_exactly_once_and_written_without_room_around_them() {
        let mut group = Group::default();
        group.text((1.0, 2.0), Letters::MIDDLE.size(9.0).bold(), "a <b> & c");
        group.text_with_lead((1.0, 2.0), Letters::START, "<1>", "d & e");
        let svg = drawn(group);
        assert!(svg.contains(">a &lt;b&gt; &amp; c</text>"), "{svg}");
        assert!(svg.contains(">&lt;1&gt;</tspan> d &amp; e</text>"), "{svg}");
        let words = r#"font-size="9" font-weight="bold" text-anchor="middle" x="1.0" y="2.0""#;
        assert!(svg.contains(words), "{svg}");
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut group = Group::default();
            let area = Area {
                left: 0.0,
                top: 0.0,
                width: bad,
                height: 1.0,
            };
            group.circle((bad, 0.0), 1.0, Style::INHERITED);
            group.circle((0.0, 0.0), bad, Style::INHERITED);
            group.rect(area, Style::INHERITED);
            group.turned_rect((0.0, bad), [1.0, 1.0], 0.0, Style::INHERITED);
            group.turned_rect((0.0, 0.0), [1.0, 1.0], bad, Style::INHERITED);
            group.line((0.0, 0.0), (0.0, bad), Style::INHERITED);
            group.polyline([(bad, 0.0), (0.0, bad)], Style::INHERITED);
            group.text((0.0, bad), Letters::START, "words");
            group.add_clipped(area, Group::default());
            let frame = Frame {
                area: Area { width: 1.0, ..area },
                x: [0.0, bad],
                y: [bad, 1.0],
            };
            frame.curve(&mut group, [(0.5, 0.5)], Style::INHERITED);
            frame.bar(&mut group, [0.0, 0.5], 0.5, Style::INHERITED);
            frame.ticks_below(&mut group, 1.0);
            frame.numbers_left(&mut group, bad);
            let svg = drawn(group);
            assert_eq!(svg.lines().count(), 3, "root, background, end: {svg}");
        }
        let mut group = Group::default();
        let places = [(0.0, 0.0), (f64::NAN, 1.0), (2.0, f64::INFINITY), (3.0, 3.0)];
        group.polyline(places, Style::INHERITED);
        assert!(drawn(group).contains("points=\"0.0,0.0 3.0,3.0\""));
    }

    #[test]
    fn a_group_says_once_what_holds_for_everything_in_it() {
        let mut group = Group::new(Style::line(Colour::BLUE, 1.5).dashed([5.0, 3.0]).round_ends());
        group.line((0.0, 0.0), (1.0, 1.0), Style::INHERITED);
        group.circle(
            (0.0, 0.0),
            1.0,
            Style::filled(Colour::rgb([255, 0, 16])).opacity(0.5),
        );
        let mut content = Group::default();
        let area = Area {
            left: 1.0,
            top: 2.0,
            width: 30.0,
            height: 4.0,
        };
        content.add_clipped(area, group);
        assert_eq!(
            drawn(content).lines().collect::<Vec<_>>(),
            [
                "<svg font-family=\"sans-serif\" font-size=\"12\" height=\"50\" viewBox=\"0 0 100 50\" width=\"100\" \
                 xmlns=\"http://www.w3.org/2000/svg\">",
                "<rect fill=\"#ffffff\" height=\"50\" width=\"100\"/>",
                "<clipPath id=\"clip_1_2_30_4\">",
                "<rect height=\"4.0\" width=\"30.0\" x=\"1.0\" y=\"2.0\"/>",
                "</clipPath>",
                "<g clip-path=\"url(#clip_1_2_30_4)\" fill=\"none\" stroke=\"#0072b2\" stroke-dasharray=\"5 3\" \
                 stroke-linecap=\"round\" stroke-width=\"1.5\">",
                "<line x1=\"0.0\" x2=\"1.0\" y1=\"0.0\" y2=\"1.0\"/>",
                "<circle cx=\"0.0\" cy=\"0.0\" fill=\"#ff0010\" fill-opacity=\"0.5\" r=\"1.0\"/>",
                "</g>",
                "</svg>",
            ]
        );
    }
}
