"""Resolution chosen for a tolerance; the error of the image, estimated by source."""
