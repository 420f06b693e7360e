//! Which layers go into the file.

use crate::error::{Error, Result};
use crate::film::{LAYERS, Layer};

/// The layers of the output file.
#[derive(Clone, Debug)]
pub struct Selection {
    layers: Vec<&'static Layer>,
    /// Somebody named the layers.
    named: bool,
}

impl Selection {
    /// Reads `none` (the beauty alone), `basic`, `all`, or names of layers separated by commas; the
    /// beauty is always there.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] listing the layers there are.
    pub fn parse(text: &str) -> Result<Self> {
        let chosen = |pick: &dyn Fn(&Layer) -> bool| {
            LAYERS.iter().filter(|l| l.name.is_empty() || pick(l)).collect()
        };
        let set = |layers| Ok(Self { layers, named: false });
        match text {
            "none" => set(chosen(&|_| false)),
            "basic" => set(chosen(&|l| l.basic)),
            "all" => set(chosen(&|_| true)),
            list => {
                let names: Vec<&str> = list.split(',').map(str::trim).collect();
                if let Some(unknown) =
                    names.iter().find(|n| n.is_empty() || !LAYERS.iter().any(|l| l.name == **n))
                {
                    let known: Vec<_> =
                        LAYERS.iter().map(|l| l.name).filter(|n| !n.is_empty()).collect();
                    return Err(Error::InvalidArgument(format!(
                        "there is no layer `{unknown}`; the layers are {}, and none, basic, all stand for sets of them",
                        known.join(", ")
                    )));
                }
                Ok(Self { layers: chosen(&|l| names.contains(&l.name)), named: true })
            }
        }
    }

    /// The layers in the order of the file.
    pub fn layers(&self) -> &[&'static Layer] {
        &self.layers
    }

    /// The layers of a picture that was `denoised` or not: without that, sets leave out the layers
    /// that show it as it was before.
    pub fn of(&self, denoised: bool) -> impl Iterator<Item = &'static Layer> {
        let all = self.named || denoised;
        self.layers.iter().copied().filter(move |l| all || !l.noisy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_and_names() {
        assert_eq!(Selection::parse("none").unwrap().layers().len(), 1);
        assert_eq!(Selection::parse("all").unwrap().layers().len(), LAYERS.len());
        let two = Selection::parse("N,gi.error").unwrap();
        assert_eq!(two.layers().iter().map(|l| l.name).collect::<Vec<_>>(), ["", "N", "gi.error"]);
        let count = |text, denoised| Selection::parse(text).unwrap().of(denoised).count();
        assert_eq!(count("all", false) + 4, count("all", true));
        assert_eq!(count("noisy.glossy_direct", false), 2);
        assert!(Selection::parse("N,nonsense").unwrap_err().to_string().contains("nonsense"));
    }
}
