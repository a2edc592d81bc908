//! Lines of text for people.

/// Columns.
pub const WIDTH: usize = 100;

/// `label` and `text` in lines of [`WIDTH`] columns; those after the first begin below the text's begin.
pub fn wrapped(label: &str, text: &str) -> String {
    let indent = label.chars().count();
    let mut result = label.to_owned();
    let mut column = indent;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if column > indent {
            if column + 1 + length > WIDTH {
                result += "\n";
                result += &" ".repeat(indent);
                column = indent;
            } else {
                result += " ";
                column += 1;
            }
        }
        result += word;
        column += length;
    }
    result + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words() {
        let text = wrapped("  ab   ", &"word ".repeat(40));
        assert!(text.lines().count() > 1 && text.lines().all(|line| line.chars().count() <= WIDTH));
        assert!(text.lines().skip(1).all(|line| line.starts_with("       word")), "{text}");
        assert_eq!(wrapped("x ", "one two"), "x one two\n");
    }
}
