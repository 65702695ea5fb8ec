"""What the site needs beside Sphinx and its extensions: `links` leads the repository's links within the site."""
