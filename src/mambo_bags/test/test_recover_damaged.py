"""What is saved of a damaged bag is a whole bag, whatever the damage was."""

import random

from fuzzing import damage_bag, framed, records, spoilt, spoilt_records
from mambo_bags import mcap_reader, recover
import pytest
from synthetic import make_flight


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """Return the file of a short flight."""
    folder = tmp_path_factory.mktemp('whole') / 'flight'
    make_flight(folder, 0.5)
    return folder / 'flight_0.mcap'


@pytest.mark.parametrize('number', range(12))
def test_what_is_saved_is_whole(number, whole, tmp_path, capsys):
    file = tmp_path / 'damaged.mcap'
    damage_bag(random.Random(f'recover {number}'), whole, file)
    code = recover.main([str(file), str(tmp_path / 'saved')])
    error = capsys.readouterr().err
    if code == 0:
        contents = mcap_reader.scan(tmp_path / 'saved/saved_0.mcap')
        assert contents.complete and not contents.lost
        return
    assert code in (1, 2)
    assert error.startswith('recover: ') and error.count('\n') == 1
    assert not (tmp_path / 'saved').exists()


def test_records_in_their_frames_are_the_file_again(whole):
    data, magic = whole.read_bytes(), mcap_reader.MAGIC
    assert magic + framed(records(data)) + magic == data


@pytest.mark.parametrize('damage', [
    lambda rng, data: spoilt(rng, data),
    lambda rng, data: framed(spoilt_records(rng, records(data)))])
def test_damage_is_the_same_at_each_run_of_a_seed(damage, whole):
    data = whole.read_bytes()
    first, again, other = (damage(random.Random(seed), data) for seed in (1, 1, 2))
    assert first == again != other
