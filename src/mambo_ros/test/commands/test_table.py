"""The table of services: their types answer with success and message, their names are unique."""

from mambo_ros.commands import table

SERVICES = [one for one in vars(table).values() if isinstance(one, table.Service)]


def test_every_service_answers_with_success_and_message():
    assert len(SERVICES) == len({one.name for one in SERVICES}) == 7
    for one in SERVICES:
        assert one.srv_type.Response.get_fields_and_field_types() == {
            'success': 'boolean', 'message': 'string'}


def test_a_type_is_named_as_ros_names_it():
    assert table.TAKEOFF.type_name == 'mambo_interfaces/srv/Takeoff'
    assert table.PAUSE.type_name == 'std_srvs/srv/SetBool'
