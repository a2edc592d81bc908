//! stub
/// stub
pub struct Builder;
