/** The decoding worker in one script: a page of another origin can load no further ones. */

import "./cloud_planes_script";
import "./worker";
