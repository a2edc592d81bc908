/// stub
pub struct TreeStats;
