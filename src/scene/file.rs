//! stub
pub(super) fn load(_path: &std::path::Path) -> crate::Result<super::Scene> {
    todo!()
}
