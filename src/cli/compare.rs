//! `caustica compare`.

use super::args::CompareArgs;
use super::console;
use caustica::{Error, Result, image_io, metrics};

pub(super) fn run(args: &CompareArgs) -> Result<()> {
    let c = metrics::compare(&image_io::read(&args.image)?, &image_io::read(&args.reference)?)?;
    if args.json {
        // JSON knows no infinity and no NaN: they become null.
        let json = serde_json::to_string(&c).map_err(|e| Error::Runtime(e.to_string()))?;
        console::result(&json);
    } else {
        let [r, g, b] = c.bias;
        console::result(&format!(
            "rmse {:.4e}\nrelmse {:.4e}\nmae {:.4e}\nbias {r:+.4e} {g:+.4e} {b:+.4e}\npsnr {:.2}\nflip {:.4}",
            c.rmse, c.relmse, c.mae, c.psnr, c.flip
        ));
    }
    Ok(())
}
