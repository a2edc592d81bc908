//! The words of NFF and OFF texts: what stands between blanks, line ends and comments, and on which line.

use super::text::number;

/// A word and the number of its line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Word<'a> {
    pub(super) text: &'a [u8],
    pub(super) line: usize,
}

impl Word<'_> {
    /// The number that it is; one that float32 cannot hold is infinite.
    pub(super) fn number(&self) -> Option<f32> {
        number(self.text)
    }
}

/// Iterates over the words of a text. Lines end with `\n`, `\r\n` or `\r`; `#` begins a comment anywhere.
#[derive(Debug, Clone)]
pub(super) struct Words<'a> {
    rest: &'a [u8],
    line: usize,
}

impl<'a> Words<'a> {
    /// The words of `text`.
    pub(super) fn new(text: &'a [u8]) -> Self {
        Words { rest: text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text), line: 1 }
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = Word<'a>;

    fn next(&mut self) -> Option<Word<'a>> {
        let is_line_end = |b: &u8| matches!(b, b'\n' | b'\r');
        loop {
            let (&first, after) = self.rest.split_first()?;
            if first == b'#' {
                let end = self.rest.iter().position(is_line_end).unwrap_or(self.rest.len());
                self.rest = &self.rest[end..];
            } else if first.is_ascii_whitespace() {
                // "\r\n" is one line end: its second byte is the one that counts.
                self.line += usize::from(is_line_end(&first) && !self.rest.starts_with(b"\r\n"));
                self.rest = after;
            } else {
                let ends = |b: &u8| b.is_ascii_whitespace() || *b == b'#';
                let end = self.rest.iter().position(ends).unwrap_or(self.rest.len());
                let (text, rest) = self.rest.split_at(end);
                self.rest = rest;
                return Some(Word { text, line: self.line });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_know_their_lines() {
        let text = b"\xef\xbb\xbf# NFF\r\nl 1#c\r2.5\n\n\tx\xff #";
        let words: Vec<_> = Words::new(text).map(|w| (w.text, w.line, w.number())).collect();
        let expected: [(&[u8], usize, Option<f32>); 4] =
            [(b"l", 2, None), (b"1", 2, Some(1.0)), (b"2.5", 3, Some(2.5)), (b"x\xff", 5, None)];
        assert_eq!(words, expected);
    }
}
