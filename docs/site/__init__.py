"""What the site needs beside Sphinx and its extensions: `links` leads links of the repository's pages within the site."""
