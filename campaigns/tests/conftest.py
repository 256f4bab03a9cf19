"""What the campaigns' tests have of the others."""

from tests.conftest import _no_file_stays as _no_file_stays  # pyright: ignore[reportPrivateUsage]
from tests.conftest import shared_data as shared_data
